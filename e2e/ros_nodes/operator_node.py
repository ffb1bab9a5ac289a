"""`python3 -m ros_nodes.operator_node`: sends /cmd_vel at a steady rate and prints every round trip as CSV (ros_nodes.trips)."""

import argparse
import os
import sys
import time
from collections.abc import Callable
from typing import TextIO

from ros_nodes.bus import Bus, Stamp
from ros_nodes.connect import connect, end_on_request
from ros_nodes.trips import FOREIGN, FRAME, HEADER, READY, SENT, TRIP, Row

_LONGEST_WAIT_S = 0.05


class OperatorNode:
    """`clock` counts ns from anywhere."""

    def __init__(
        self, bus: Bus, *, app: str, rate_hz: float, out: TextIO, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._bus = bus
        self._app = app
        self._period_ns = int(1e9 / rate_hz)
        self._out = out
        self._clock = clock
        self._began_ns = clock()
        self._number = 0

    def wait_connected(self, pause: Callable[[float], None] = time.sleep) -> None:
        while not self._bus.connected():
            pause(0.01)
        self._write(READY, 0)

    def run(self, count: int) -> None:
        """Send `count` commands (0: for ever); answers are taken while waiting for the next one's time."""
        next_ns = self._clock()
        while not count or self._number < count:
            ahead_ns = next_ns - self._clock()
            if ahead_ns <= 0:
                self._send()
                next_ns += self._period_ns
                # After a stop of the whole machine go on from now instead of sending all that was missed at once.
                next_ns = max(next_ns, self._clock() - self._period_ns)
            else:
                self._hear(min(ahead_ns / 1e9, _LONGEST_WAIT_S))

    def _send(self) -> None:
        self._number += 1
        self._write(SENT, self._number)
        self._bus.send(Stamp(app=self._app, number=self._number, sent_ns=self._clock()))

    def _hear(self, timeout_s: float) -> None:
        stamps = self._bus.take(timeout_s)
        now_ns = self._clock()
        for stamp in stamps:
            if stamp.app == self._app:
                self._write(TRIP, stamp.number, rtt_us=(now_ns - stamp.sent_ns) // 1000)
            else:
                self._write(FOREIGN, stamp.number)
        for size_bytes in self._bus.take_frames():
            self._write(FRAME, size_bytes)

    def _write(self, kind: str, number: int, rtt_us: int | None = None) -> None:
        at_us = (self._clock() - self._began_ns) // 1000
        self._out.write(Row(kind, number, at_us, rtt_us).as_csv() + "\n")
        self._out.flush()


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="operator_node")
    parser.add_argument("--hz", type=float, default=50, help="commands per second")
    parser.add_argument("--count", type=int, default=0, help="commands to send; 0: for ever")
    arguments = parser.parse_args(argv)
    end_on_request()
    sys.stdout.write(f"{HEADER}\n")
    app = os.environ.get("ROBOTAPP_APP", "operator")
    node = OperatorNode(connect("operator"), app=app, rate_hz=arguments.hz, out=sys.stdout)
    node.wait_connected()
    node.run(arguments.count)


if __name__ == "__main__":
    main()
