"""Run as a script: the latency switch once more in Python, as small as it can be, to measure what the language costs.

    python -I -S python_switch.py SOCKET [--bare]

No product and no substitute: per frame it does what the one in Go does but for bandwidth (delay, jitter in order, loss, counters); it has
no metrics, cuts, limits or ports that end. Of the control protocol of e2e/latency_switch it knows `attach`, `get` and `set` for two
nodes. `--bare` leaves out the rule as well: what is left are the system calls that any such switch makes for a frame. Standard
library only, nothing of the package.
"""

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any

TUNSETIFF, IFF_TAP, IFF_NO_PI, CLONE_NEWNET = 0x400454CA, 2, 0x1000, 0x40000000
PR_SET_TIMERSLACK = 29
FRAMES_PER_ROUND = 64
FRAME_BYTES = 2048


def open_tap(pid: int, name: str) -> int:
    """A TAP in the network namespace of a process, up."""
    made: list[int] = []

    def inside() -> None:
        with open(f"/proc/{pid}/ns/net") as namespace:  # noqa: PTH123 - pathlib has no advantage for a descriptor
            if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "setns")
        descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
        command = f"ip link set {name} txqueuelen 10000 up"
        subprocess.run(command.split(), check=True)
        made.append(descriptor)

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    return made[0]


class Link:
    """One direction."""

    def __init__(self) -> None:
        self.delay_s = self.jitter_s = self.loss = self.latest_s = 0.0
        self.frames = self.octets = self.lost = 0
        self.luck = random.Random(1).random

    def due_s(self, now_s: float) -> float | None:
        """When a frame that enters now comes out; None is never."""
        luck, wobble = self.luck(), self.luck()
        if luck < self.loss:
            self.lost += 1
            return None
        self.latest_s = max(now_s + self.delay_s + wobble * self.jitter_s, self.latest_s)
        return self.latest_s


class Switch:
    """Ports are descriptors of TAPs."""

    def __init__(self, path: str) -> None:
        self.names: dict[str, int] = {}
        self.links: dict[tuple[int, int], Link] = {}
        self.learned: dict[bytes, int] = {}
        self.flights: list[tuple[float, int, int, Link, bytes]] = []
        self.count = 0
        self.sources: list[int] = []
        self.control = socket.socket(socket.AF_UNIX)
        self.control.bind(path)
        self.control.listen()
        self.sources.append(self.control.fileno())

    def run(self) -> None:
        while True:
            for descriptor in select.select(self.sources, (), (), self.deliver())[0]:
                if descriptor == self.control.fileno():
                    self.obey()
                else:
                    self.receive(descriptor)

    def deliver(self) -> float | None:
        """Write what is due; seconds until the next is, None for ever."""
        flights = self.flights
        while flights:
            ahead_s = flights[0][0] - time.monotonic()
            if ahead_s > 0:
                return ahead_s
            _, _, port, link, frame = heapq.heappop(flights)
            self.write(port, link, frame)
        return None

    def receive(self, origin: int) -> None:
        read, learned = os.read, self.learned
        for _ in range(FRAMES_PER_ROUND):
            try:
                frame = read(origin, FRAME_BYTES)
            except BlockingIOError:
                return
            learned[frame[6:12]] = origin
            target = None if frame[0] & 1 else learned.get(frame[:6])
            if target is not None:
                self.send(origin, target, frame)
            else:
                for port in self.names.values():
                    if port != origin:
                        self.send(origin, port, frame)

    def send(self, origin: int, target: int, frame: bytes) -> None:
        link = self.links[origin, target]
        now_s = time.monotonic()
        due_s = link.due_s(now_s)
        if due_s is None:
            return
        if due_s <= now_s:
            self.write(target, link, frame)
        else:
            self.count += 1
            heapq.heappush(self.flights, (due_s, self.count, target, link, frame))

    @staticmethod
    def write(port: int, link: Link, frame: bytes) -> None:
        with suppress(OSError):
            os.write(port, frame)
            link.frames += 1
            link.octets += len(frame)

    def obey(self) -> None:
        connection, _ = self.control.accept()
        with connection, connection.makefile("rw") as lines:
            lines.write(json.dumps({"ok": True, **self.answer(json.loads(lines.readline()))}) + "\n")

    def answer(self, command: dict[str, Any]) -> dict[str, Any]:
        if command["op"] == "attach":
            port = open_tap(command["pid"], command["tap"])
            self.links |= {pair: Link() for other in self.names.values() for pair in ((port, other), (other, port))}
            self.names[command["node"]] = port
            self.sources.append(port)
        elif command["op"] == "set":
            for change in command["links"]:
                ends = self.names[change["from"]], self.names[change["to"]]
                for pair in [ends] if change["one_way"] else [ends, ends[::-1]]:
                    self.links[pair].delay_s = change.get("delay_ms", 0) / 1000
                    self.links[pair].loss = change.get("loss", 0)
                    self.links[pair].jitter_s = change.get("jitter_ms", 0) / 1000
        return {"nodes": list(self.names)}


class BareSwitch(Switch):
    """What comes out of one of two ports goes into the other."""

    def receive(self, origin: int) -> None:
        read, write = os.read, os.write
        (target,) = (port for port in self.names.values() if port != origin)
        with suppress(OSError):  # nothing more to read
            for _ in range(FRAMES_PER_ROUND):
                write(target, read(origin, FRAME_BYTES))


def run_switch() -> None:
    os.setpriority(os.PRIO_PROCESS, 0, -15)  # as the switch in Go, and its timer slack
    ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1000, 0, 0, 0)
    kind = BareSwitch if "--bare" in sys.argv[2:] else Switch
    kind(sys.argv[1]).run()


if __name__ == "__main__":
    run_switch()
