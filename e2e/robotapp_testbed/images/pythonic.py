"""Recipes of the images with Python: Debian's interpreter below, locked wheels and our code above."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import pins
from robotapp_testbed.images import bytecode, debian, wheels
from robotapp_testbed.images.oci import Config
from robotapp_testbed.images.recipes import PATH, Recipe, skeleton

_BASE: Final = ("python3-minimal", "libpython3-stdlib", "libstdc++6")
_SHELL: Final = ("dash", "coreutils", "libc-bin")
"""What the operator's init step needs (sh, sleep, getent), and env, which starts whatever a container's arguments name."""

_ROS_1: Final = (
    *("python3-rospy", "python3-roslaunch", "python3-rosmaster", "python3-rostopic", "rosout"),
    *("python3-std-msgs", "python3-geometry-msgs", "python3-sensor-msgs"),
)
_HOME: Final = "opt/robotapp"
_ROS_NODES: Final = pins.REPOSITORY / "e2e" / "ros_nodes"


class Pythonic(Recipe):
    """`packages` are Debian's, besides the interpreter; `selection` says what of uv.lock; `code` is copied on top."""

    packages: Sequence[str] = ()
    selection: Sequence[str] = ()
    entrypoint: Sequence[str] = ("/usr/bin/python3",)

    def code(self) -> list[Path]:
        return []

    def copy_code(self, target: Path) -> None:
        """Put the files of `code` below `target`, which is on Python's path."""

    def inputs(self) -> bytes:
        digest = hashlib.sha256(repr([debian.closure(_BASE), debian.closure(self._debian())]).encode())
        digest.update(wheels.requirements(*self.selection).encode() if self.selection else b"")
        for path in self.code():
            digest.update(str(path.relative_to(pins.REPOSITORY)).encode() + path.read_bytes())
        return digest.digest()

    def fill(self, scratch: Path) -> Sequence[Path]:
        base = skeleton(scratch / "base")
        debian.unpack(_BASE, base)
        bytecode.compile_all(base, base, "usr/lib")
        layers = [base]
        if self.packages:
            layers.append(self._debian_layer(base, scratch / "packages"))
        if self.selection:
            layers.append(self._wheel_layer(base, scratch / "wheels"))
        if self.code():
            layers.append(self._code_layer(base, scratch / "code"))
        return layers

    def config(self) -> Config:
        env = {"PATH": PATH, "PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": f"/{_HOME}"}
        return Config(entrypoint=self.entrypoint, architecture=pins.platform_names()["arch"], env=env)

    def _debian(self) -> tuple[str, ...]:
        return (*_BASE, *self.packages)

    def _debian_layer(self, base: Path, layer: Path) -> Path:
        layer.mkdir()
        debian.unpack(self._debian(), layer, without=_BASE)
        shell = layer / "usr" / "bin" / "sh"
        if not shell.exists():  # made by dash's maintainer script, which does not run
            shell.symlink_to("dash")
        bytecode.compile_all(base, layer, "usr/lib")
        return layer

    def _wheel_layer(self, base: Path, layer: Path) -> Path:
        (layer / _HOME).mkdir(parents=True)
        wheels.install(wheels.requirements(*self.selection), layer / _HOME, python=bytecode.python_version(base))
        bytecode.compile_all(base, layer, _HOME)
        return layer

    def _code_layer(self, base: Path, layer: Path) -> Path:
        (layer / _HOME).mkdir(parents=True)
        self.copy_code(layer / _HOME)
        bytecode.compile_all(base, layer, _HOME)
        return layer


class Component(Pythonic):
    """One of our deployed programs, with the dependencies of its extra, as its Dockerfile has it."""

    def __init__(self, name: str) -> None:
        self.selection = ("--no-dev", "--extra", name)
        self.entrypoint = ("/usr/bin/python3", "-m", f"robotapp_{name}")

    def code(self) -> list[Path]:
        return wheels.sources()

    def copy_code(self, target: Path) -> None:
        wheels.install_ours(target)


class RosNodes(Pythonic):
    """The programs of e2e/ros_nodes with what they need of ROS. Like the ros images, one runs what its arguments name."""

    packages: Sequence[str] = _SHELL
    entrypoint = ("/usr/bin/env",)

    def code(self) -> list[Path]:
        return sorted(_ROS_NODES.glob("*.py"))

    def copy_code(self, target: Path) -> None:
        for path in self.code():
            (target / _ROS_NODES.name).mkdir(exist_ok=True)
            (target / _ROS_NODES.name / path.name).write_bytes(path.read_bytes())


class Ros2(RosNodes):
    """Cyclone DDS with its Python IDL: nodes speak with the names ROS 2 has on the wire."""

    selection = ("--only-group", "ros")


class Ros1(RosNodes):
    """Debian's own ROS 1: roscore, rospy and message packages."""

    packages = (*_SHELL, *_ROS_1)
