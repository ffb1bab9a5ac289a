"""Sends velocity commands at a steady rate and measures how long each answer of the robot takes."""

import csv
import time
from pathlib import Path

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from reference_teleop.round_trips import RoundTrips

SUMMARY_PERIOD_S = 5.0


class Operator(Node):
    """An answer carries the stamp of its command, so that clocks of two machines are never compared."""

    def __init__(self):
        super().__init__("operator")
        self._rate_hz = self.declare_parameter("rate_hz", 20.0).value
        self._trips = RoundTrips(self.declare_parameter("deadline_ms", 50.0).value)
        self._speed = self.declare_parameter("speed", 0.3).value
        self._turn = self.declare_parameter("turn", 0.2).value
        self._file, self._rows = self._open_csv(self.declare_parameter("csv", "").value)
        self._commands = self.create_publisher(TwistStamped, "cmd_vel", 10)
        self.create_subscription(Odometry, "robot_state", self._on_state, 10)
        self.create_timer(1 / self._rate_hz, self._send)
        self.create_timer(SUMMARY_PERIOD_S, self._log_summary)

    def close(self):
        self._log_summary()
        if self._file:
            self._file.close()

    def _open_csv(self, path):
        if not path:
            return None, None
        file = Path(path).open("w", newline="")
        rows = csv.writer(file)
        rows.writerow(["sent_s", "rtt_ms"])
        return file, rows

    def _send(self):
        if not self._commands.get_subscription_count():
            return  # there is no robot yet
        command = TwistStamped()
        command.header.stamp = self.get_clock().now().to_msg()
        command.twist.linear.x = self._speed
        command.twist.angular.z = self._turn
        self._trips.send(key_of(command), time.monotonic())
        self._commands.publish(command)
        for key in self._trips.give_up(time.monotonic()):
            self._write(key, "")

    def _on_state(self, state):
        rtt_ms = self._trips.answer(key_of(state), time.monotonic())
        if rtt_ms is not None:
            self._write(key_of(state), f"{rtt_ms:.3f}")

    def _write(self, key, rtt_ms):
        """A row without a time is a command that was never answered."""
        if self._rows:
            seconds, nanoseconds = key
            self._rows.writerow([f"{seconds}.{nanoseconds:09d}", rtt_ms])
            self._file.flush()

    def _log_summary(self):
        # print, not the logger: at the end rclpy has shut down already.
        print(self._trips.summary(), flush=True)


def key_of(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


def main():
    rclpy.init()
    operator = Operator()
    try:
        rclpy.spin(operator)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        operator.close()


if __name__ == "__main__":
    main()
