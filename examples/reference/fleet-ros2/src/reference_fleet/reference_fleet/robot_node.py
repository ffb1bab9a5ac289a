"""Asks for a task, works on it, reports it, and asks again."""

import json

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

STATUS_PERIOD_S = 0.2


class Robot(Node):
    """A robot of the fleet, named like its node. Numbers of its tasks only grow, so an answer that comes twice or late is known by its number."""

    def __init__(self):
        super().__init__("robot")
        self._name = self.get_name()
        self._work_s = self.declare_parameter("work_s", 0.5).value
        self._working_on = None
        self._done = None
        self._last = 0
        self._worker = None
        self._status = self.create_publisher(String, "fleet_status", 10)
        self.create_subscription(String, "assignments", self._on_assignment, 10)
        self.create_timer(STATUS_PERIOD_S, self._report)

    def _on_assignment(self, message):
        assignment = json.loads(message.data)
        task = assignment["task"]
        if assignment["robot"] != self._name or task is None or self._working_on is not None or task <= self._last:
            return
        self._working_on = self._last = task
        self._worker = self.create_timer(self._work_s, self._finish)

    def _finish(self):
        self._worker.cancel()
        # The line stands for what the task does in the world.
        print(f"{self._name} did task {self._working_on}", flush=True)
        self._done, self._working_on = self._working_on, None
        self._report()

    def _report(self):
        status = {"robot": self._name, "working_on": self._working_on, "done": self._done}
        self._status.publish(String(data=json.dumps(status)))


def main():
    rclpy.init()
    try:
        rclpy.spin(Robot())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
