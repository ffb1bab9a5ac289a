"""Locked wheels as image content: the versions and hashes of uv.lock, nothing that tells where or when they were installed."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotapp_testbed import pins
from robotapp_testbed.failures import TestbedError

PACKAGES: Final = (
    # What the wheel of RobotApp holds, as in pyproject.toml (a test keeps the two equal).
    "crds/robotapp_api",
    "operator/robotapp_operator",
    "scheduler/robotapp_scheduler",
    "cli/robotapp_cli",
    "rigel_bridge/rigel_bridge",
)
_UV: Final = Path(sys.executable).with_name("uv")
_KEPT_METADATA: Final = ("METADATA", "WHEEL", "entry_points.txt", "top_level.txt")
_PLATFORMS: Final = {"amd64": "x86_64-manylinux_2_28", "arm64": "aarch64-manylinux_2_28"}


def requirements(*selection: str) -> str:
    """Pinned names with hashes of an extra (`--extra operator --no-dev`) or group, from uv.lock alone, offline."""
    command = [str(_UV), "export", "--frozen", "--offline", "--quiet", "--no-header", "--no-emit-project", *selection]
    return _run(command, cwd=pins.REPOSITORY)


def install(wanted: str, target: Path, *, python: str) -> None:
    """Unpack the wheels of `wanted` (text of `requirements`) for Python `python` ("3.11") into `target`."""
    listed = target.with_suffix(".requirements")
    listed.write_text(wanted)
    command = [str(_UV), "pip", "install", "--quiet", "--no-deps", "--require-hashes", "--only-binary=:all:"]
    command += [f"--python-version={python}", f"--python-platform={_PLATFORMS[pins.platform_names()['arch']]}"]
    _run([*command, f"--target={target}", f"--requirements={listed}"], cwd=target.parent)
    listed.unlink()
    _forget_the_machine(target)


def copy_packages(target: Path) -> None:
    """Our own code, as the wheel has it."""
    for package in PACKAGES:
        source = pins.REPOSITORY / package
        shutil.copytree(source, target / source.name, ignore=shutil.ignore_patterns("__pycache__"))


def sources() -> list[Path]:
    """The files `copy_packages` copies."""
    found = (path for package in PACKAGES for path in (pins.REPOSITORY / package).rglob("*") if path.is_file())
    return sorted(path for path in found if "__pycache__" not in path.parts)


def _forget_the_machine(target: Path) -> None:
    shutil.rmtree(target / "bin", ignore_errors=True)  # scripts that name the installing interpreter
    (target / ".lock").unlink(missing_ok=True)
    for metadata in target.glob("*.dist-info"):
        for path in metadata.iterdir():
            if path.is_file() and path.name not in _KEPT_METADATA:
                path.unlink()


def _run(command: Sequence[str], *, cwd: Path) -> str:
    result = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        reason = (result.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise TestbedError(f"the locked wheels cannot be had ({reason}): check the package index and try again")
    return result.stdout
