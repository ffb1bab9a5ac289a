"""The list of tasks: who has them, and which are done, in a journal on disk that a new coordinator reads."""

import json
import os
from pathlib import Path


class TaskBook:
    """Every change is on disk before anybody hears of it, so what was promised survives the coordinator.

    A task that was given to a robot belongs to that robot until it reports the end of it: a robot that is silent may be
    working on it, and giving it to another one could have it done twice.
    """

    def __init__(self, path, count):
        self._path = Path(path)
        self.owner = dict.fromkeys(range(1, count + 1))
        self.done = {}
        self._read()
        self._file = self._path.open("a")

    def close(self):
        self._file.close()

    def task_of(self, robot):
        """Returns the task that a robot has and has not finished, or None."""
        return next((task for task, owner in self.owner.items() if owner == robot and task not in self.done), None)

    def give(self, robot):
        """Returns the task that a robot has, else gives it the next open one; None when none is left."""
        task = self.task_of(robot)
        if task is None:
            task = next((task for task, owner in self.owner.items() if owner is None), None)
            if task is not None:
                self._write({"task": task, "given": robot})
                self.owner[task] = robot
        return task

    def finish(self, task, robot):
        """Notes the end of a task. Returns False for one that the robot does not have, or that it reported before."""
        if self.owner.get(task) != robot or task in self.done:
            return False
        self._write({"task": task, "done": robot})
        self.done[task] = robot
        return True

    def _write(self, entry):
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self):
        """Reads the journal. A last line without its end was being written when the coordinator died: nobody heard of it."""
        text = self._path.read_text() if self._path.exists() else ""
        whole_lines = text[: text.rfind("\n") + 1]
        if whole_lines != text:
            self._path.write_text(whole_lines)
        for line in whole_lines.splitlines():
            entry = json.loads(line)
            if "given" in entry:
                self.owner[entry["task"]] = entry["given"]
            else:
                self.done[entry["task"]] = entry["done"]
