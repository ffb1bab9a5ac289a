"""Plain network namespaces joined by the latency switch: nodes without kubelets, for tests and measurements of the switch.

A namespace lives as long as its holder process, which ends with us: nothing to clean up, however a test ends.
"""

import ctypes
import os
import shutil
import socket
import struct
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeVar

import pytest

from robotapp_testbed.processes.process import spawn, wait_until
from robotapp_testbed.switch import LatencySwitch

_T = TypeVar("_T")
_CLONE_NEWNET = 0x40000000
SO_TIMESTAMPNS = 35  # of asm-generic: x86-64 and arm64
TAP = "lat0"


def missing() -> str:
    """One sentence on what this machine lacks for network namespaces and TAPs; empty when nothing."""
    if os.geteuid() != 0:
        return "network namespaces and TAP devices need root: run as root, or let CI run it"
    if not Path("/dev/net/tun").exists():
        return "the kernel offers no /dev/net/tun: modprobe tun"
    lacking = [name for name in ("ip", "unshare", "nsenter") if shutil.which(name) is None]
    if lacking:
        return f"{', '.join(lacking)} is missing: apt-get install iproute2 util-linux"
    tried = subprocess.run(["unshare", "--net", "true"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"network namespaces cannot be made here: {tried.stderr.strip()}"


def skip_where_impossible() -> None:
    reason = missing()
    if reason:
        pytest.skip(reason)


@dataclass(frozen=True, slots=True)
class Namespace:
    name: str
    pid: int
    address: str

    def run(self, *command: str) -> str:
        entered = ["nsenter", f"--target={self.pid}", "--net", *command]
        return subprocess.run(entered, capture_output=True, text=True, check=True).stdout

    def inside(self, work: Callable[[], _T]) -> _T:
        """The answer of `work`, done by a thread that is in the namespace. Sockets it opens stay there."""
        answers: list[_T] = []

        def enter() -> None:
            with Path(f"/proc/{self.pid}/ns/net").open() as namespace:
                if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), _CLONE_NEWNET):
                    raise OSError(ctypes.get_errno(), "setns")
            answers.append(work())

        thread = threading.Thread(target=enter, name=f"inside-{self.name}")
        thread.start()
        thread.join()
        return answers[0]

    def udp(self, port: int = 0) -> socket.socket:
        def make() -> socket.socket:
            made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            made.bind((self.address, port))
            return made

        return self.inside(make)


class Wire:
    """`with Wire(["a", "b"]) as wire:` namespaces with one TAP each (10.9.0.1, 10.9.0.2 …) on a switch of their own."""

    def __init__(self, names: Sequence[str], *, seed: int = 0) -> None:
        self._names = list(names)
        self._seed = seed
        self._stack = ExitStack()
        self.nodes: dict[str, Namespace] = {}

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.run_dir = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robotapp-wire-")))
            self.switch = LatencySwitch(run_dir=self.run_dir, seed=self._seed)
            stack.callback(self.switch.process.kill)
            self.switch.start()
            for number, name in enumerate(self._names, start=1):
                stack.enter_context(self.node(name, f"10.9.0.{number}"))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @contextmanager
    def node(self, name: str, address: str) -> Iterator[Namespace]:
        """Attach one more node for the time of the block."""
        holder = spawn(["/usr/bin/unshare", "--net", "/bin/sleep", "infinity"], run_dir=self.run_dir, log=2)
        try:
            own = _namespace(os.getpid())
            if not wait_until(lambda: _program(holder.pid) == "sleep" and _namespace(holder.pid) != own, timeout_s=60):
                raise AssertionError(f"no namespace for {name}")
            node = self.nodes[name] = Namespace(name=name, pid=holder.pid, address=address)
            node.run("sh", "-c", "echo 1 > /proc/sys/net/ipv6/conf/default/disable_ipv6")
            self.switch.attach(name, pid=holder.pid, tap=TAP)
            node.run("ip", "address", "add", f"{address}/24", "dev", TAP)
            yield node
        finally:
            self.nodes.pop(name, None)
            holder.kill()
            holder.wait()

    def settle(self) -> None:
        """Let every node learn the others' addresses, so that the first measured packet waits for no ARP."""
        for origin in self.nodes.values():
            with origin.udp() as sender:
                for target in self.nodes.values():
                    if target is not origin:
                        with target.udp(40_000) as receiver:
                            receiver.settimeout(30)
                            sender.sendto(b"hello", (target.address, 40_000))
                            receiver.recv(64)


def round_trips_ms(origin: Namespace, target: Namespace, *, count: int, pause_s: float) -> list[float]:
    """ICMP echo, answered by the target's kernel and stamped by the origin's when the answer comes: how soon this program
    is woken does not count. Lost ones are left out."""
    found = []
    with origin.inside(lambda: socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)) as pinger:
        pinger.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        pinger.settimeout(1)
        for number in range(count):
            request = _echo_request(number)
            began_ns = time.time_ns()
            pinger.sendto(request, (target.address, 0))
            came_ns = _reply_came_ns(pinger, target, number)
            if came_ns is not None:
                found.append((came_ns - began_ns) / 1e6)
            time.sleep(pause_s)
    return found


def _reply_came_ns(pinger: socket.socket, target: Namespace, number: int) -> int | None:
    """A raw socket also gets the replies to other pings of its node."""
    try:
        while True:
            packet, ((_, _, stamp),), _, (source, _) = pinger.recvmsg(256, 256)
            if source == target.address and packet[20] == 0 and int.from_bytes(packet[26:28], "big") == number:
                return stamp_ns(stamp)
    except TimeoutError:
        return None


def stamp_ns(message: bytes) -> int:
    """When the kernel got a packet, from the ancillary message that SO_TIMESTAMPNS brings."""
    seconds, nanoseconds = struct.unpack("@qq", message)
    return int(seconds * 1_000_000_000 + nanoseconds)


def _echo_request(number: int) -> bytes:
    body = b"\x08\x00\x00\x00" + os.getpid().to_bytes(4, "big")[2:] + number.to_bytes(2, "big") + bytes(48)
    total = sum(int.from_bytes(body[at : at + 2], "big") for at in range(0, len(body), 2))
    total = (total & 0xFFFF) + (total >> 16)
    checksum = ~(total + (total >> 16)) & 0xFFFF
    return body[:2] + checksum.to_bytes(2, "big") + body[4:]


def _program(pid: int) -> str:
    return Path(f"/proc/{pid}/comm").read_text().strip()


def _namespace(pid: int) -> str:
    return str(Path(f"/proc/{pid}/ns/net").readlink())
