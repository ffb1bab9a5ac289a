"""Counts the readings that arrive, and prints when they stay away and come back."""

import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Temperature

from reference_sensor.arrivals import Arrivals

CHECK_PERIOD_S = 0.1
SUMMARY_PERIOD_S = 5.0


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        silent_after_s = self.declare_parameter("silent_after_s", 2.0).value
        self._arrivals = Arrivals(silent_after_s, time.monotonic())
        self.create_subscription(Temperature, "temperature", self._on_temperature, 10)
        self.create_timer(CHECK_PERIOD_S, self._check)
        self.create_timer(SUMMARY_PERIOD_S, self.log_summary)

    def _on_temperature(self, message):
        print_event(self._arrivals.take(message.temperature, time.monotonic()))

    def _check(self):
        print_event(self._arrivals.check(time.monotonic()))

    def log_summary(self):
        print_event(self._arrivals.summarize())


def print_event(sentence):
    # print, not the logger: at the end rclpy has shut down already.
    if sentence:
        print(sentence, flush=True)


def main():
    rclpy.init()
    listener = Listener()
    try:
        rclpy.spin(listener)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        listener.log_summary()


if __name__ == "__main__":
    main()
