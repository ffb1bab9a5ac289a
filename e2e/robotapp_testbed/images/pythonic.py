"""Recipes of the images with Python: Debian's interpreter below, locked wheels and our code above."""

import hashlib
import os
import shutil
from collections.abc import Sequence
from dataclasses import replace
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
_JAZZY: Final = "opt/ros/jazzy"
_JAZZY_PROGRAMS: Final = ("fastdds", "fast-discovery-server", "fast-discovery-server-1.0.1")
_FOR_COMPILERS: Final = ("usr/include", "usr/lib/gcc")
_JAZZY_LEFT_OUT: Final = ("include", "lib64")
_SETUP: Final = """\
export AMENT_PREFIX_PATH={home}
export LD_LIBRARY_PATH={libraries}
export PATH={home}/bin:$PATH
export PYTHONPATH={packages}:$PYTHONPATH
export ROS_VERSION=2 ROS_DISTRO=jazzy _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
"""
_ROS_NODES: Final = pins.REPOSITORY / "e2e" / "ros_nodes"
_RECORDER: Final = pins.REPOSITORY / "recorder" / "robotapp_recorder"
_RECORDER_WHEELS: Final = ("--no-dev", "--extra", "recorder")
_NO_BYTECODE: Final = shutil.ignore_patterns("__pycache__")
_ZENOH_FILES: Final = {
    "rclpy/__init__.py": "from ros_nodes.zenoh.stand_in import create_node, init, spin_once\n",
    "rclpy/qos.py": "from ros_nodes.zenoh.stand_in import DurabilityPolicy, QoSProfile, ReliabilityPolicy\n",
    "std_msgs/msg.py": "from ros2_pyterfaces.cydr.std_msgs.msg import *\n",
    "ros2": "#!/bin/sh\n# ros2 run rmw_zenoh_cpp rmw_zenohd\nexec python3 -m ros_nodes.zenoh.router\n",
}


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
            layers.append(self.wheel_layer(base, scratch / "wheels"))
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

    def wheel_layer(self, base: Path, layer: Path) -> Path:
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
    """One of our deployed programs, with the dependencies of its extra, as its Dockerfile has it. `extra`: unless it has its name."""

    def __init__(self, name: str, *, extra: str = "") -> None:
        self.selection = ("--no-dev", "--extra", extra or name)
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

    packages: Sequence[str] = (*_SHELL, *_ROS_1)

    def inputs(self) -> bytes:
        return super().inputs() + repr(_FOR_COMPILERS).encode()

    def _debian_layer(self, base: Path, layer: Path) -> Path:
        """Leaves out what compilers alone read: Debian's ROS depends on Boost's headers, 15,000 files that each node would unpack."""
        layer = super()._debian_layer(base, layer)
        for folder in _FOR_COMPILERS:
            shutil.rmtree(layer / folder, ignore_errors=True)
        return layer


class Zenoh(RosNodes):
    """The wire format of rmw_zenoh, a router under the name by which the operator starts it, and a stand-in for rclpy."""

    packages = (*_SHELL, "bash", "grep", "util-linux")
    selection = ("--only-group", "zenoh")

    def inputs(self) -> bytes:
        return super().inputs() + repr(_ZENOH_FILES).encode()

    def code(self) -> list[Path]:
        return [*super().code(), *sorted((_ROS_NODES / "zenoh").glob("*.py"))]

    def copy_code(self, target: Path) -> None:
        """Also what the operator's programs look for: the command `ros2`, and the modules that its readiness probe imports."""
        shutil.copytree(_ROS_NODES, target / _ROS_NODES.name, ignore=_NO_BYTECODE)
        for name, text in _ZENOH_FILES.items():
            (target / name).parent.mkdir(exist_ok=True)
            (target / name).write_text(text)
        (target / "ros2").chmod(0o755)

    def config(self) -> Config:
        config = super().config()
        variables = {"PATH": f"/{_HOME}:{PATH}", "GIT_PYTHON_REFRESH": "quiet"}
        return replace(config, env={**(config.env or {}), **variables})


def _link_copies(folder: Path) -> None:
    """Puts links for libraries that are there several times, because wheels can hold no links."""
    seen: dict[bytes, Path] = {}
    for path in sorted(folder.rglob("*.so*")):
        if path.is_symlink() or not path.is_file():
            continue
        first = seen.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)
        if first != path:
            path.unlink()
            path.symlink_to(os.path.relpath(first, path.parent))


class Ros2Jazzy(RosNodes):
    """ROS 2 Jazzy with rclpy, Fast DDS and its discovery server, laid out and started like the official images; and the recorder.

    Its variables are set by the entry point, not by the image: what the kubelet starts in the container does without them.
    """

    packages = (*_SHELL, "bash", "grep", "util-linux", "libpython3.11")
    selection = ("--only-group", "rclpy", "--no-emit-package", "empy", "--no-emit-package", "setuptools")
    entrypoint = ("/ros_entrypoint.sh",)

    def inputs(self) -> bytes:
        recorder = wheels.requirements(*_RECORDER_WHEELS).encode()
        return super().inputs() + recorder + repr((_SETUP, _JAZZY_PROGRAMS, _JAZZY_LEFT_OUT, "links")).encode()

    def code(self) -> list[Path]:
        return [*super().code(), *sorted(_RECORDER.glob("*.py"))]

    def copy_code(self, target: Path) -> None:
        shutil.copytree(_ROS_NODES, target / _ROS_NODES.name, ignore=shutil.ignore_patterns("__pycache__", "zenoh"))
        shutil.copytree(_RECORDER, target / _RECORDER.name, ignore=_NO_BYTECODE)

    def wheel_layer(self, base: Path, layer: Path) -> Path:
        home = layer / _JAZZY
        home.mkdir(parents=True)
        python = bytecode.python_version(base)
        wheels.install(wheels.requirements(*self.selection), home, python=python, programs=_JAZZY_PROGRAMS)
        for folder in _JAZZY_LEFT_OUT:
            shutil.rmtree(home / folder)
        _link_copies(home)
        libraries = ":".join(f"/{path.relative_to(layer)}" for path in (home / "lib", *sorted(home.glob("*.libs"))))
        packages = f"/{_JAZZY}/lib/python{python}/site-packages:/{_JAZZY}"
        (home / "setup.bash").write_text(_SETUP.format(home=f"/{_JAZZY}", libraries=libraries, packages=packages))
        (layer / "ros_entrypoint.sh").write_text(f'#!/bin/bash\nset -e\n. "/{_JAZZY}/setup.bash"\nexec "$@"\n')
        (layer / "ros_entrypoint.sh").chmod(0o755)
        (layer / _HOME).mkdir(parents=True)
        wheels.install(wheels.requirements(*_RECORDER_WHEELS), layer / _HOME, python=python)
        bytecode.compile_all(base, layer, _HOME)
        return layer

    def config(self) -> Config:
        env = {"PATH": PATH, "PYTHONUNBUFFERED": "1", "PYTHONPATH": f"/{_HOME}"}
        return Config(entrypoint=self.entrypoint, architecture=pins.platform_names()["arch"], env=env)
