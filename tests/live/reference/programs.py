"""Runs the nodes of an application of examples/reference from its image, in a network that has nothing else in it."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_testbed import images
from robotapp_testbed.processes import guard
from robotapp_testbed.processes.process import Process
from robotapp_testbed.real.image_box import ImageBox

_ROS_2: Final = {
    "PATH": "/usr/local/bin:/usr/bin:/bin",
    "PYTHONPATH": "/opt/robotapp",
    "PYTHONUNBUFFERED": "1",
    "HOME": "/tmp",  # noqa: S108 - within the image
    "ROS_DOMAIN_ID": "7",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
}
_SOURCE: Final = "source /opt/ros/jazzy/setup.bash"
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

    def __init__(self, app: str, folder: Path) -> None:
        logs = folder / "logs"
        logs.mkdir(parents=True)
        (folder / guard.REGISTER).mkdir()
        self._box = ImageBox(app, folder=folder / "box", run_dir=folder, logs_dir=logs)
        self._programs: dict[str, Process] = {}
        self._box.start(images.archive(app))
        (self.root / "opt" / "robotapp" / "watch.py").write_text(_WATCH_ROS_2)

    @property
    def root(self) -> Path:
        """Folder that the programs see as /."""
        return self._box.root

    def start(self, name: str, line: str, env: Mapping[str, str] | None = None) -> None:
        """Starts a line of bash, such as `ros2 run PACKAGE EXECUTABLE`; under the same name again once it has ended."""
        self._programs[name] = self._box.program(name, f"{_SOURCE}; exec {line}", {**_ROS_2, **(env or {})})
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
        """Ends a program at once, as the loss of its node does."""
        self._programs[name].kill()

    def stop(self, name: str) -> None:
        """Ends a program as the kubelet does."""
        self._programs[name].stop()

    def close(self) -> None:
        for program in self._programs.values():
            program.kill()
        self._box.box.kill()
