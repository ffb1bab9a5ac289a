"""Runs the nodes of an application of examples/reference from its image, in a network that has nothing else in it."""

import os
import re
import signal
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from robotapp_testbed import images
from robotapp_testbed.processes import guard
from robotapp_testbed.real.box import Inside, children
from robotapp_testbed.real.image_box import ImageBox

_ENVIRONMENT: Final = {
    "PATH": "/usr/local/bin:/usr/bin:/bin",
    "PYTHONPATH": "/opt/robotapp",
    "PYTHONUNBUFFERED": "1",
    "HOME": "/tmp",  # noqa: S108 - within the image
}
_ROS_1: Final = {
    "ROS_MASTER_URI": "http://127.0.0.1:11311",
    "ROS_IP": "127.0.0.1",
    "ROS_PACKAGE_PATH": "/ws/install/share",
}
_ROS_2: Final = {"ROS_DOMAIN_ID": "7", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
_SET_UP: Final = {1: "", 2: ". /opt/ros/jazzy/setup.bash; "}
_WATCH_ROS_1: Final = '''\
"""watch.py MODULE TYPE TOPIC EXPRESSION: prints time and what the expression makes of each message `m`."""
import importlib, sys, time, rospy
module, kind, topic, expression = sys.argv[1:]
rospy.init_node("watcher", anonymous=True)
rospy.Subscriber(topic, getattr(importlib.import_module(module), kind),
    lambda m: print(f"{time.monotonic():.3f}", eval(expression)))
rospy.spin()
'''
_WATCH_ROS_2: Final = '''\
"""watch.py MODULE TYPE TOPIC EXPRESSION: prints time and what the expression makes of each message `m`."""
import importlib, sys, time, rclpy
module, kind, topic, expression = sys.argv[1:]
rclpy.init()
node = rclpy.create_node("watcher")
node.create_subscription(getattr(importlib.import_module(module), kind), topic,
    lambda m: print(f"{time.monotonic():.3f}", eval(expression)), 10)
rclpy.spin(node)
'''


class Programs:
    """Nodes of one application, by the name that a test gives them."""

    def __init__(self, app: str, box: ImageBox) -> None:
        self._ros = 1 if app.endswith("ros1") else 2
        self._box = box
        self._programs: dict[str, Inside] = {}
        self._watcher.parent.mkdir(parents=True, exist_ok=True)
        self._watcher.write_text({1: _WATCH_ROS_1, 2: _WATCH_ROS_2}[self._ros])
        for folder in ("results", "state"):
            for file in (self.root / folder).iterdir():
                file.unlink()
        if self._ros == 1:
            self.start("master", "roscore")

    @property
    def root(self) -> Path:
        """Folder that the programs see as /."""
        return self._box.root

    @property
    def _watcher(self) -> Path:
        return self.root / "opt" / "robotapp" / "watch.py"

    def start(self, name: str, line: str, env: Mapping[str, str] | None = None) -> None:
        """Starts a line of sh, such as `ros2 run PACKAGE EXECUTABLE`; under the same name again once it has ended."""
        variables = {**_ENVIRONMENT, **{1: _ROS_1, 2: _ROS_2}[self._ros], **(env or {})}
        self._programs[name] = self._box.program(name, f"{_SET_UP[self._ros]}exec {line}", variables)
        self._programs[name].start()

    def watch(self, name: str, kind: str, topic: str, expression: str) -> None:
        """Starts a node that logs what the expression makes of each message `m` of the type MODULE.TYPE."""
        module, _, message = kind.rpartition(".")
        self.start(name, f"python3 /opt/robotapp/watch.py {module} {message} {topic} '{expression}'")

    def seen(self, name: str) -> list[tuple[float, str]]:
        """Returns time and value of each message that a watcher has seen."""
        rows = (line.split(" ", 1) for line in self.log(name).splitlines() if re.match(r"\d+\.\d+ ", line))
        return [(float(at_s), value) for at_s, value in rows]

    def log(self, name: str) -> str:
        """Returns what the program has printed, over all its starts."""
        return self._programs[name].log_text()

    def kill(self, name: str) -> None:
        """Ends a program and what it started at once, as the loss of its node does."""
        self._signal(name, signal.SIGKILL)
        self._programs[name].kill()

    def pause(self, name: str) -> None:
        """Holds a program and what it started still, as a robot that is out of reach."""
        self._signal(name, signal.SIGSTOP)

    def resume(self, name: str) -> None:
        self._signal(name, signal.SIGCONT)

    def _signal(self, name: str, number: signal.Signals) -> None:
        for pid in reversed(list_descendants(self._programs[name].pid)):
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    def stop(self, name: str) -> None:
        """Ends a program as the kubelet does."""
        self._programs[name].stop()

    def close(self) -> None:
        """Ends all programs and forgets what they printed."""
        for name, program in self._programs.items():
            self.kill(name)
            program.log_path.unlink()


def list_descendants(pid: int) -> list[int]:
    """Returns what a process has started, parents before children."""
    started = children(pid)
    return [*started, *(below for child in started for below in list_descendants(child))]


def start_box(app: str, folder: Path) -> ImageBox:
    """Unpacks the image of an application into namespaces of its own."""
    logs = folder / "logs"
    logs.mkdir(parents=True)
    (folder / guard.REGISTER).mkdir()
    box = ImageBox(app, folder=folder / "box", run_dir=folder, logs_dir=logs)
    box.start(images.archive(app))
    return box
