"""Logs that outlive their control plane, for the person who looks at a failed test."""

import shutil
from pathlib import Path

from robotapp_testbed.binaries.cache import cache_home

_KEPT = 10


def kept_root() -> Path:
    return cache_home() / "logs"


def keep(source: Path, target: Path) -> None:
    """Move the folder `source` to `target`, then drop the oldest neighbours beyond ten."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(source, target)
    target.touch()
    oldest_first = sorted(target.parent.iterdir(), key=lambda path: path.stat().st_mtime)
    for path in oldest_first[:-_KEPT]:
        shutil.rmtree(path, ignore_errors=True)
