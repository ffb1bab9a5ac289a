"""What the latency switch is worth on this machine: accuracy of delay and loss, capacity, between plain namespaces."""

import math
import socket
import statistics
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from campaigns.network import udp_load
from campaigns.network.namespaced import Namespace, Wire, round_trips_ms
from robotapp_testbed.processes.process import wait_until

PORT = 40_001
HEADERS_BYTES = 42  # Ethernet, IPv4 and UDP
_RECEIVE_BUFFER_BYTES = 64 << 20
_SO_RCVBUFFORCE = 33
_LOT = 4000
"""The queue of a TAP holds two of them and more."""
PATIENCE_S = 30.0


@dataclass(frozen=True, slots=True)
class Delay:
    set_ms: float
    """One way."""
    error_ms: float
    """Median round trip minus twice the delay."""
    p99_error_ms: float


@dataclass(frozen=True, slots=True)
class Loss:
    set_share: float
    seen_share: float

    @property
    def error(self) -> float:
        return abs(self.seen_share - self.set_share) / self.set_share


@dataclass(frozen=True, slots=True)
class Capacity:
    """One direction, no delay. `cpu_share` is the switch's, of one core."""

    payload_bytes: int
    sent: int
    received: int
    seconds: float
    cpu_share: float

    @property
    def frames_s(self) -> float:
        return self.received / self.seconds

    @property
    def mbit_s(self) -> float:
        return self.frames_s * (self.payload_bytes + HEADERS_BYTES) * 8 / 1e6

    @property
    def lost(self) -> int:
        return self.sent - self.received


def delay(wire: Wire, set_ms: float, *, count: int) -> Delay:
    wire.switch.set_link("a", "b", delay_ms=set_ms)
    trips = sorted(round_trips_ms(wire.nodes["a"], wire.nodes["b"], count=count, pause_s=0.005)) or [math.inf]
    wire.switch.set_link("a", "b", delay_ms=0)
    return Delay(set_ms, statistics.median(trips) - 2 * set_ms, trips[int(len(trips) * 0.99)] - 2 * set_ms)


def loss(wire: Wire, set_share: float, *, count: int) -> Loss:
    """By the receiver's count, not the switch's. The datagrams come in lots, the next one when the switch has done with the
    one before: none is lost for want of speed."""
    wire.switch.set_link("a", "b", loss=set_share, one_way=True)
    origin, target = wire.nodes["a"], wire.nodes["b"]
    sent = received = 0
    with receiving(target) as receiver, origin.udp() as sender:
        all_passed = True
        while all_passed and sent < count:
            goal = _passed(wire) + _LOT
            for _ in range(_LOT):
                sender.sendto(bytes(64), (target.address, PORT))
            sent += _LOT
            all_passed = _passes(wire, goal)
            received += _waiting(receiver)
    wire.switch.set_link("a", "b", loss=0)
    return Loss(set_share, (sent - received) / sent)


def _passed(wire: Wire) -> float:
    """Frames from a to b that the switch delivered or dropped so far."""
    dropped = wire.switch.counts("dropped_frames_total")
    lost = sum(count for (origin, target, _), count in dropped.items() if (origin, target) == ("a", "b"))
    return wire.switch.counts("frames_total")["a", "b"] + lost


def _passes(wire: Wire, goal: float) -> bool:
    """Wait until so many passed, and for one more round of the switch: an ARP frame may have been counted for the last one."""
    return wait_until(lambda: _passed(wire) >= goal, timeout_s=PATIENCE_S) and _passed(wire) >= goal


def _waiting(receiver: socket.socket) -> int:
    """How many datagrams are there; a delivered frame is in the receiver's buffer at once."""
    receiver.setblocking(False)
    buffer, found = bytearray(2048), 0
    with suppress(BlockingIOError):
        while True:
            receiver.recv_into(buffer)
            found += 1
    return found


@contextmanager
def receiving(target: Namespace) -> Iterator[socket.socket]:
    with target.udp(PORT) as receiver:
        with suppress(PermissionError):  # then the kernel's own limit is the buffer
            receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _RECEIVE_BUFFER_BYTES)
        yield receiver


def load(wire: Wire, *, per_second: float, payload_bytes: int, seconds: float) -> Capacity:
    origin, target = wire.nodes["a"], wire.nodes["b"]
    with receiving(target) as receiver, origin.udp() as sender:
        before_s = wire.switch.process.cpu_seconds()
        counting = _start(receiver, "count", "1.5")
        sending = _start(sender, "send", target.address, PORT, per_second, payload_bytes, seconds)
        sent = int(sending.communicate()[0])
        cpu_s = wire.switch.process.cpu_seconds() - before_s
        received = int(counting.communicate()[0])
    return Capacity(payload_bytes, sent, received, seconds, cpu_s / seconds)


def _start(file: socket.socket, verb: str, *arguments: object) -> "subprocess.Popen[str]":
    descriptor = file.fileno()
    command: Sequence[str] = [sys.executable, udp_load.__file__, verb, str(descriptor), *map(str, arguments)]
    return subprocess.Popen(command, pass_fds=[descriptor], stdout=subprocess.PIPE, text=True, cwd=Path("/"))
