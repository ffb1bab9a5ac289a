"""`python3 -m ros_nodes.robot_node`: answers every /cmd_vel with /robot_state; may send camera images beside."""

import argparse
import time
from collections.abc import Callable

from ros_nodes.bus import Bus
from ros_nodes.connect import connect, end_on_request

_LONGEST_WAIT_S = 0.5


class RobotNode:
    """`camera_hz` 0 is no camera. `clock` counts seconds from anywhere."""

    def __init__(
        self, bus: Bus, *, camera_hz: float, camera_bytes: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._bus = bus
        self._period_s = 1 / camera_hz if camera_hz else None
        self._camera_bytes = camera_bytes
        self._clock = clock
        self._next_frame_s = clock()

    def step(self) -> None:
        """Answer what comes until the next image is due, then send it."""
        ahead_s = _LONGEST_WAIT_S if self._period_s is None else self._next_frame_s - self._clock()
        if ahead_s > 0:
            for stamp in self._bus.take(min(ahead_s, _LONGEST_WAIT_S)):
                self._bus.send(stamp)
        elif self._period_s is not None:
            self._bus.send_frame(self._camera_bytes)
            self._next_frame_s = max(self._next_frame_s + self._period_s, self._clock())


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="robot_node")
    parser.add_argument("--camera-hz", type=float, default=0, help="images per second; 0: no camera")
    parser.add_argument("--camera-bytes", type=int, default=0, help="bytes of an image")
    arguments = parser.parse_args(argv)
    end_on_request()
    node = RobotNode(connect("robot"), camera_hz=arguments.camera_hz, camera_bytes=arguments.camera_bytes)
    while True:
        node.step()


if __name__ == "__main__":
    main()
