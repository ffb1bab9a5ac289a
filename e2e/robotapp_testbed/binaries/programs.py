"""Our own small Go programs under e2e/: compiled once per state of their sources, kept in the cache."""

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache, gobuild, pins
from robotapp_testbed.progress import Progress

FOLDERS: Final = {"latency-switch": "latency_switch", "pause": "pause", "cluster-dns": "cluster_dns"}
"""Program name → folder under e2e: what clusters with real nodes run."""
TOOLS: Final = {"cel-cost": "cel_cost"}
"""The same for programs that are compiled when somebody wants to know something."""

_COSTS: Final = {"latency-switch": (2, 1), "pause": (1, 1), "cluster-dns": (15, 78), "cel-cost": (5, 2)}
"""Seconds on two cores, and packages, to compile after the binaries of the control plane."""


def sources(folder: Path) -> list[Path]:
    """What a program is compiled from: its module files and its code, tests left out."""
    code = (path for path in folder.rglob("*.go") if not path.name.endswith("_test.go"))
    return sorted([*code, *folder.glob("go.*")])


def source_key(folder: Path) -> str:
    """Changes with the sources and the settings, not with the Go that compiles them."""
    digest = hashlib.sha256(pins.build_settings().encode())
    for path in sources(folder):
        digest.update(str(path.relative_to(folder)).encode() + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def build(name: str, *, progress: Progress | None = None, env: Mapping[str, str] = os.environ) -> Path:
    """Path of the compiled program; compiles it first when its sources have changed."""
    folder = pins.REPOSITORY / "e2e" / (FOLDERS | TOOLS)[name]
    home = cache.cache_home(env)
    store = cache.Store(home / "programs" / source_key(folder))
    present = store.get(name)
    if present:
        return present
    compile_s, packages = _COSTS[name]
    binary = pins.Binary(name=name, package=".", compile_s=compile_s, packages=packages, release=None)
    return gobuild.build_all([binary], store, home=home, progress=progress or Progress(), env=env, module_dir=folder)[
        name
    ]
