"""Locked wheels as image content: the versions and hashes of uv.lock, nothing that tells where or when they were installed."""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import pins
from robotapp_testbed.failures import TestbedError, last_words

_UV: Final = Path(sys.executable).with_name("uv")
_KEPT_METADATA: Final = ("METADATA", "WHEEL", "entry_points.txt", "top_level.txt")
_PLATFORMS: Final = {"amd64": "x86_64-manylinux_2_28", "arm64": "aarch64-manylinux_2_28"}


def requirements(*selection: str) -> str:
    """Pinned names with hashes of an extra (`--extra operator --no-dev`) or group, from uv.lock alone, offline."""
    command = [str(_UV), "export", "--frozen", "--offline", "--quiet", "--no-header", "--no-emit-project", *selection]
    return _run(command, cwd=pins.REPOSITORY)


def install(wanted: str, target: Path, *, python: str, programs: Sequence[str] = ()) -> None:
    """Unpack the wheels of `wanted` (text of `requirements`) for Python `python` ("3.11") into `target`.

    programs: what is kept of its `bin`; the rest are scripts that name the installing interpreter.
    """
    listed = target.with_suffix(".requirements")
    listed.write_text(wanted)
    command = [str(_UV), "pip", "install", "--quiet", "--no-deps", "--require-hashes", "--only-binary=:all:"]
    command += [f"--python-version={python}", f"--python-platform={_PLATFORMS[pins.platform_names()['arch']]}"]
    _run([*command, f"--target={target}", f"--requirements={listed}"], cwd=target.parent)
    listed.unlink()
    _forget_the_machine(target, programs)


def install_ours(target: Path) -> None:
    """RobotApp itself, by way of its wheel."""
    _run([str(_UV), "build", "--quiet", "--wheel", f"--out-dir={target.with_suffix('.dist')}"], cwd=pins.REPOSITORY)
    (wheel,) = target.with_suffix(".dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(target)
    _forget_the_machine(target)


def sources() -> list[Path]:
    """What our wheel is made from."""
    project = pins.REPOSITORY / "pyproject.toml"
    packages = tomllib.loads(project.read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    found = [path for package in packages for path in (pins.REPOSITORY / package).rglob("*") if path.is_file()]
    code = sorted(path for path in found if "__pycache__" not in path.parts)
    return [project, pins.REPOSITORY / "README.md", *code]


def _forget_the_machine(target: Path, programs: Sequence[str] = ()) -> None:
    for script in (target / "bin").glob("*"):
        if script.name not in programs:
            script.unlink()
    if not programs:
        shutil.rmtree(target / "bin", ignore_errors=True)
    (target / ".lock").unlink(missing_ok=True)
    for metadata in target.glob("*.dist-info"):
        for path in metadata.iterdir():
            if path.is_file() and path.name not in _KEPT_METADATA:
                path.unlink()


def _run(command: Sequence[str], *, cwd: Path) -> str:
    result = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        reason = last_words(result.stderr)
        raise TestbedError(f"the locked wheels cannot be had ({reason}): check the package index and try again")
    return result.stdout
