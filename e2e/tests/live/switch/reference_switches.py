"""Measures of what this machine can do: a switch in Python, a switch that does nothing, and how long frames take over either."""

import math
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

from campaigns.network.namespaced import SO_TIMESTAMPNS, Wire, stamp_ns
from campaigns.network.switch_figures import PATIENCE_S, PORT, receiving
from robotapp_testbed.processes.process import Process
from robotapp_testbed.switch import LatencySwitch

PROGRAM: Final = Path(__file__).with_name("python_switch.py")


class PythonSwitch(LatencySwitch):
    """The same switch as far as a measurement needs it, in Python."""

    options: ClassVar[Sequence[str]] = ()

    def __init__(self, *, run_dir: Path, seed: int = 0) -> None:
        super().__init__(run_dir=run_dir, seed=seed)
        self.process = Process(
            "python-switch",
            [sys.executable, "-I", "-S", str(PROGRAM), str(self.path), *self.options],
            run_dir=run_dir,
            log_path=run_dir / "python-switch.log",
            ready=self._serves,
        )


class BareSwitch(PythonSwitch):
    """Joins two nodes by the system calls that a switch cannot do without, and does nothing else with a frame."""

    options = ("--bare",)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Frames that the switch forwarded one after the other, as the receiver's kernel stamped them."""

    sent: int
    came_ns: Sequence[int]

    @property
    def lost(self) -> int:
        return self.sent - len(self.came_ns)

    @property
    def us_per_frame(self) -> float:
        gaps = len(self.came_ns) - 1
        return (max(self.came_ns) - min(self.came_ns)) / gaps / 1000 if gaps > 0 else math.inf


def least_in_turns(
    one: Callable[[], float], other: Callable[[], float], *, enough: Callable[[float, float], bool], most: int
) -> tuple[float, float]:
    """The smallest result of either, called in turns, until these two are enough or `most` of each were taken.

    Other work of the machine only ever adds to a time, and adds to both: a calm moment for each is all it takes.
    """
    ours = theirs = math.inf
    for _ in range(most):
        ours, theirs = min(ours, one()), min(theirs, other())
        if enough(ours, theirs):
            break
    return ours, theirs


def stretch(wire: Wire, *, count: int, payload_bytes: int) -> Stretch:
    """Let frames queue before the switch while it stands still, then let it forward them: the sender's pace plays no part."""
    origin, target = wire.nodes["a"], wire.nodes["b"]
    with receiving(target) as receiver, origin.udp() as sender:
        receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        receiver.settimeout(PATIENCE_S)
        sender.sendto(b"hello", (target.address, PORT))  # nothing in the stretch waits for ARP
        receiver.recv(64)
        process = wire.switch.process
        process.pause()
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        began_s = time.monotonic()
        for _ in range(count):
            sender.sendto(bytes(payload_bytes), (target.address, PORT))
        process.resume()
        time.sleep(2 * (time.monotonic() - began_s))  # as a rule it is through then, and no reader slowed it down
        return Stretch(count, tuple(_stamps_ns(receiver, count)))


def _stamps_ns(receiver: socket.socket, count: int) -> Iterator[int]:
    with suppress(TimeoutError):
        for _ in range(count):
            _, ((_, _, stamp),), _, _ = receiver.recvmsg(2048, 256)
            yield stamp_ns(stamp)
