"""Gives tasks to robots that ask for one, and keeps what it has given on disk."""

import json
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

from reference_fleet.tasks import TaskBook

SUMMARY_PERIOD_S = 5.0


class Coordinator(Node):
    def __init__(self):
        super().__init__("coordinator")
        store = self.declare_parameter("store", "tasks.jsonl").value
        self._book = TaskBook(store, self.declare_parameter("tasks", 60).value)
        self._silent_after_s = self.declare_parameter("silent_after_s", 3.0).value
        self._heard_s = {}
        self._silent = set()
        print(f"{len(self._book.done)} of {len(self._book.owner)} tasks are done", flush=True)
        self._assignments = self.create_publisher(String, "assignments", 10)
        self.create_subscription(String, "fleet_status", self._on_status, 10)
        self.create_timer(0.5, self._watch)
        self.create_timer(SUMMARY_PERIOD_S, self._log_summary)

    def _on_status(self, message):
        """A robot reports what it has done last, until it has a new task: so a report or an answer may be lost."""
        status = json.loads(message.data)
        robot = status["robot"]
        self._heard_s[robot] = time.monotonic()
        if status["done"] is not None:
            self._book.finish(status["done"], robot)
        if status["working_on"] is None:
            task = self._book.give(robot)
            self._assignments.publish(String(data=json.dumps({"robot": robot, "task": task})))

    def _watch(self):
        silent_robots = {
            robot for robot, at_s in self._heard_s.items() if time.monotonic() - at_s > self._silent_after_s
        }
        for robot in silent_robots - self._silent:
            print(f"{robot} is silent, task {self._book.task_of(robot)} waits for it", flush=True)
        for robot in self._silent - silent_robots:
            print(f"{robot} is back", flush=True)
        self._silent = silent_robots

    def _log_summary(self):
        print(f"{len(self._book.done)} of {len(self._book.owner)} tasks are done", flush=True)


def main():
    rclpy.init()
    try:
        rclpy.spin(Coordinator())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
