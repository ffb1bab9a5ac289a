"""Remove what the kernel leaves of a dead cluster of real nodes: its cgroup folders and its run folder.

    python -I -S sweep.py RUN_DIR CGROUP HOST_LINK

Processes, mounts and links are gone by themselves: they lived in namespaces whose first process has died. The kernel
takes a moment for it, which is waited for. Runs as a script after the guard, so it uses nothing of the package.
"""

import os
import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path

CGROUPS = Path("/sys/fs/cgroup")
LINKS = Path("/sys/class/net")
PATIENCE_S = 10.0
_PAUSE_S = 0.02


def hierarchies(root: Path = CGROUPS) -> list[Path]:
    """The roots of all cgroup hierarchies: one with cgroup v2, one per group of controllers with v1."""
    if (root / "cgroup.controllers").exists():
        return [root]
    return sorted(path for path in root.iterdir() if path.is_dir() and not path.is_symlink())


def remove_cgroups(name: str, *, root: Path = CGROUPS, patience_s: float = PATIENCE_S) -> list[Path]:
    """Remove the cgroup `name` with all below it, everywhere; what is still there when patience ends."""
    deadline_s = time.monotonic() + patience_s
    while True:
        left = [path for hierarchy in hierarchies(root) if not _removed(path := hierarchy / name)]
        if not left or time.monotonic() > deadline_s:
            return left
        time.sleep(_PAUSE_S)  # the processes in it are killed but not reaped yet


def remove_folder(folder: Path, *, patience_s: float = PATIENCE_S) -> bool:
    """Whether it is gone: a program that is just dying may still write into it."""
    deadline_s = time.monotonic() + patience_s
    while folder.exists() and time.monotonic() < deadline_s:
        shutil.rmtree(folder, ignore_errors=True)
        if folder.exists():
            time.sleep(_PAUSE_S)
    return not folder.exists()


def await_no_link(name: str, *, links: Path = LINKS, patience_s: float = PATIENCE_S) -> bool:
    """Whether the host's end of a link is gone: it goes with the namespace of its other end, a moment after that."""
    deadline_s = time.monotonic() + patience_s
    while (links / name).exists() and time.monotonic() < deadline_s:
        time.sleep(_PAUSE_S)
    return not (links / name).exists()


def sweep(
    *,
    run_dir: Path | None,
    cgroup: str,
    host_link: str,
    root: Path = CGROUPS,
    links: Path = LINKS,
    patience_s: float = PATIENCE_S,
) -> list[str]:
    """What is still in a next cluster's way, in words. A folder is in nobody's."""
    left = [f"control group {path}" for path in remove_cgroups(cgroup, root=root, patience_s=patience_s)]
    if not await_no_link(host_link, links=links, patience_s=patience_s):
        left.append(f"link {host_link}")
    if run_dir:
        remove_folder(run_dir)
    return left


def _removed(cgroup: Path) -> bool:
    for folder, _, _ in os.walk(cgroup, topdown=False):
        with suppress(OSError):  # busy, or gone meanwhile
            Path(folder).rmdir()
    return not cgroup.exists()


if __name__ == "__main__":
    sweep(run_dir=Path(sys.argv[1]), cgroup=sys.argv[2], host_link=sys.argv[3])
