"""Images of the applications of examples/reference, laid out as their Dockerfiles lay them out, without Docker and colcon."""

import ast
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import pins
from robotapp_testbed.failures import TestbedError, last_words
from robotapp_testbed.images import bytecode, debian
from robotapp_testbed.images.oci import Config
from robotapp_testbed.images.pythonic import Ros1, Ros2Jazzy
from robotapp_testbed.images.recipes import PATH, skeleton

FOLDER: Final = pins.REPOSITORY / "examples" / "reference"
_INSTALL: Final = "ws/install"
_CODE: Final = "opt/robotapp"
_JAZZY: Final = "opt/ros/jazzy"
_WRITABLE: Final = ("results", "state")
_SHARED: Final = ("launch", "config")
_ROS2: Final = """\
#!/bin/bash
# What `ros2 run PACKAGE EXECUTABLE …` does; no package index has the command itself.
[ "$1" = run ] && exec "/ws/install/lib/$2/$3" "${@:4}"
echo "this image has no 'ros2 $1'" >&2
exit 2
"""
_COMPILER: Final = ("g++", "libroscpp-dev", "libgeometry-msgs-dev", "libnav-msgs-dev", "libsensor-msgs-dev")
_LIBRARIES: Final = (
    "roscpp",
    "rosconsole",
    "rostime",
    "roscpp_serialization",
    "boost_thread",
    "boost_system",
    "boost_chrono",
)
_FLAGS: Final = ("-O2", "-std=c++17", "-Wall", "-Werror", "-Wl,--build-id=none")
_EXECUTABLE: Final = "#!/usr/bin/python3\nimport sys\nfrom {module} import {function}\nsys.exit({function}())\n"


class ReferenceRos2(Ros2Jazzy):
    """An application in rclpy. `group` of uv.lock has what it uses, `trainer` is the module that writes its model at build time."""

    def __init__(self, app: str, group: str = "reference", trainer: str = "") -> None:
        self._trainer = trainer
        self.package = package_of(app)
        self.selection = ("--only-group", group, "--no-emit-package", "empy", "--no-emit-package", "setuptools")

    def inputs(self) -> bytes:
        return super().inputs() + repr((_ROS2, _EXECUTABLE, _SHARED, _WRITABLE, self._trainer)).encode()

    def fill(self, scratch: Path) -> Sequence[Path]:
        layers = super().fill(scratch)
        if self._trainer:
            train(self._trainer, self.package, layers, scratch / "root", set_up=f". /{_JAZZY}/setup.bash; ")
        return layers

    def code(self) -> list[Path]:
        return list_files(self.package)

    def _code_layer(self, base: Path, layer: Path) -> Path:
        _copy_shared(self.package, layer)
        _copy_modules(self.package, layer)
        programs = layer / _INSTALL / "lib" / self.package.name
        for executable, module, function in list_executables(self.package / "setup.py"):
            _write_program(programs / executable, _EXECUTABLE.format(module=module, function=function))
        _write_program(layer / "usr" / "local" / "bin" / "ros2", _ROS2)
        bytecode.compile_all(base, layer, _CODE)
        return layer


class ReferenceRos1(Ros1):
    """An application in rospy or roscpp: each source file of C++ in `src` is a program, each executable file in `nodes`, too.

    `group` of uv.lock has what it uses besides ROS, `trainer` is the module that writes its model at build time.
    """

    def __init__(self, app: str, group: str = "", trainer: str = "") -> None:
        self._trainer = trainer
        self.package = package_of(app)
        self.selection = ("--only-group", group) if group else ()
        self.packages = (*Ros1.packages, "python3-nav-msgs", *(["libroscpp4d"] if self._sources() else []))

    def inputs(self) -> bytes:
        compiler = repr((debian.closure(_COMPILER), _LIBRARIES, _FLAGS)) if self._sources() else ""
        trainer = self._trainer.encode()
        return super().inputs() + repr((compiler, _SHARED, _WRITABLE)).encode() + trainer

    def fill(self, scratch: Path) -> Sequence[Path]:
        layers = super().fill(scratch)
        if self._trainer:
            train(self._trainer, self.package, layers, scratch / "root")
        return layers

    def code(self) -> list[Path]:
        return list_files(self.package)

    def config(self) -> Config:
        config = super().config()
        # roslaunch writes its logs below HOME, which has no other value for a user without an entry in /etc/passwd.
        variables = {"ROS_PACKAGE_PATH": f"/{_INSTALL}/share", "HOME": "/tmp"}  # noqa: S108 - within the image
        return replace(config, env={**(config.env or {}), **variables})

    def _code_layer(self, base: Path, layer: Path) -> Path:
        _copy_shared(self.package, layer)
        programs = layer / _INSTALL / "lib" / self.package.name
        for script in sorted((self.package / "nodes").glob("*")):
            _write_program(programs / script.name, script.read_text())
        if self._sources():
            compile_programs(self._sources(), programs, scratch=layer.with_name("compiler"))
        # roslaunch without catkin looks for programs below the package's own folder.
        for program in sorted(programs.iterdir()):
            link = layer / _INSTALL / "share" / self.package.name / program.name
            link.symlink_to(os.path.relpath(program, link.parent))
        if (self.package / "src" / self.package.name).is_dir():
            _copy_modules(self.package / "src", layer)
            bytecode.compile_all(base, layer, _CODE)
        return layer

    def _sources(self) -> list[Path]:
        return sorted((self.package / "src").glob("*.cpp"))


def train(module: str, package: Path, layers: Sequence[Path], root: Path, *, set_up: str = "") -> None:
    """Runs a module in the image with the path of the package's model, which goes into the uppermost layer."""
    model = Path(_INSTALL, "share", package.name, "model.pkl")
    root.mkdir()
    for layer in layers:
        subprocess.run(["cp", "-al", "--remove-destination", f"{layer}/.", str(root)], check=True)
    line = f"{set_up}exec python3 -m {module} /{model}"
    # One thread, so that sums have one order.
    env = {"PATH": PATH, "PYTHONPATH": f"/{_CODE}", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [str(shutil.which("chroot")), str(root), "/bin/sh", "-c", line]
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise TestbedError(f"{module} does not write its model: {last_words(done.stderr)}")
    shutil.copyfile(root / model, layers[-1] / model)


def compile_programs(sources: Sequence[Path], target: Path, *, scratch: Path) -> None:
    """Compiles each source file to a program of its name, with Debian's compiler and roscpp in a system of their own."""
    root = skeleton(scratch)
    debian.unpack(_COMPILER, root)
    shutil.copytree(sources[0].parent, root / "build")
    for source in sources:
        libraries = [f"-l{library}" for library in _LIBRARIES]
        command = ["chroot", str(root), "/usr/bin/g++", *_FLAGS, "-o", f"/build/{source.stem}", f"/build/{source.name}"]
        done = subprocess.run([*command, *libraries], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise TestbedError(f"{source.relative_to(pins.REPOSITORY)} does not compile: {last_words(done.stderr)}")
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(root / "build" / source.stem, target / source.stem)


def list_files(package: Path) -> list[Path]:
    files = (path for path in package.rglob("*") if path.is_file())
    return sorted(path for path in files if "__pycache__" not in path.parts)


def package_of(app: str) -> Path:
    """Returns the folder of an application's ROS package."""
    (package,) = (path for path in (FOLDER / app / "src").iterdir() if path.is_dir())
    return package


def list_executables(setup: Path) -> Iterator[tuple[str, str, str]]:
    """Yields name, module and function of each console script that a setup.py states as text."""
    for node in ast.walk(ast.parse(setup.read_text())):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == "console_scripts":
                    yield from map(_split_script, ast.literal_eval(value))


def _split_script(script: str) -> tuple[str, str, str]:
    name, _, target = script.partition("=")
    module, _, function = target.strip().partition(":")
    if not function:
        raise TestbedError(f"the console script {script!r} names no function: write NAME = MODULE:FUNCTION")
    return name.strip(), module, function


def _copy_shared(package: Path, layer: Path) -> None:
    """Copies the files that launch files and nodes read at run time, and makes the folders that volumes are mounted on."""
    share = layer / _INSTALL / "share" / package.name
    share.mkdir(parents=True)
    shutil.copyfile(package / "package.xml", share / "package.xml")
    for folder in _SHARED:
        if (package / folder).is_dir():
            shutil.copytree(package / folder, share / folder)
    for name in _WRITABLE:
        (layer / name).mkdir()
        (layer / name).chmod(0o1777)


def _copy_modules(parent: Path, layer: Path) -> None:
    """Copies the Python package that has the name of the ROS package."""
    name = parent.name if (parent / parent.name).is_dir() else parent.parent.name
    shutil.copytree(parent / name, layer / _CODE / name, ignore=shutil.ignore_patterns("__pycache__"))


def _write_program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
