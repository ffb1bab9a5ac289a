"""Images of the applications of examples/reference, laid out as their Dockerfiles lay them out, without Docker and colcon."""

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import pins
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images import bytecode
from robotapp_testbed.images.pythonic import Ros2Jazzy

FOLDER: Final = pins.REPOSITORY / "examples" / "reference"
_INSTALL: Final = "ws/install"
_CODE: Final = "opt/robotapp"
_SHARED: Final = ("package.xml", "launch", "config")
_ROS2: Final = """\
#!/bin/bash
# What `ros2 run PACKAGE EXECUTABLE …` does; no package index has the command itself.
[ "$1" = run ] && exec "/ws/install/lib/$2/$3" "${@:4}"
echo "this image has no 'ros2 $1'" >&2
exit 2
"""
_EXECUTABLE: Final = "#!/usr/bin/python3\nimport sys\nfrom {module} import {function}\nsys.exit({function}())\n"


class ReferenceRos2(Ros2Jazzy):
    """An application in rclpy. `group` of uv.lock has what it uses."""

    def __init__(self, app: str, group: str = "reference") -> None:
        self.package = package_of(app)
        self.selection = ("--only-group", group, "--no-emit-package", "empy", "--no-emit-package", "setuptools")

    def inputs(self) -> bytes:
        return super().inputs() + repr((_ROS2, _EXECUTABLE, _SHARED)).encode()

    def code(self) -> list[Path]:
        files = (path for path in self.package.rglob("*") if path.is_file())
        return sorted(path for path in files if "__pycache__" not in path.parts)

    def _code_layer(self, base: Path, layer: Path) -> Path:
        name = self.package.name
        shutil.copytree(self.package / name, layer / _CODE / name, ignore=shutil.ignore_patterns("__pycache__"))
        for shared in _SHARED:
            _copy(self.package / shared, layer / _INSTALL / "share" / name / shared)
        programs = layer / _INSTALL / "lib" / name
        for executable, module, function in list_executables(self.package / "setup.py"):
            _write_program(programs / executable, _EXECUTABLE.format(module=module, function=function))
        _write_program(layer / "usr" / "local" / "bin" / "ros2", _ROS2)
        (layer / "results").mkdir()
        (layer / "results").chmod(0o1777)
        bytecode.compile_all(base, layer, _CODE)
        return layer


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


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


def _write_program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
