"""What real nodes could leave on a machine: processes, namespaces, mounts, control groups, links, settings of the kernel.

Two counts are compared. What belongs to clusters of other programs on the same machine, which may come and go meanwhile,
is left out: their numbers are locked, and their processes descend from owners that live.
"""

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path

from robotapp_testbed.processes.process import wait_until
from robotapp_testbed.real import slots
from robotapp_testbed.real.config.addresses import Addresses
from robotapp_testbed.real.scripts import sweep

OURS = (
    "/real/scripts/hold.py",
    "/real/scripts/enter.py",
    "/robotapp_testbed/processes/guard.py",
    "/real/scripts/sweep.py",
    "containerd",
    "kubelet",
    "kube-proxy",
    "cluster-dns",
    "latency-switch",
)
"""In the command lines of what runs in or for a cluster."""
# Figures and random numbers that change by themselves; what belongs to a link is counted with the links.
_ALIVE_SETTINGS = re.compile(
    r"fs/(aio-nr|dentry-state|file-nr|inode-|quota/|binfmt_misc/)|kernel/(random/|ns_last_pid|pty/nr|sched_domain)|vm/stat"
    r"|net/netfilter/nf_conntrack_count|net/\w+/(conf|neigh)/(?!all/|default/)"
)
_NAMESPACES = ("net", "mnt", "uts", "ipc", "pid", "cgroup")


@dataclass(frozen=True, slots=True)
class Census:
    processes: frozenset[str]
    namespaces: frozenset[str]
    mounts: frozenset[str]
    cgroups: frozenset[str]
    links: frozenset[str]
    settings: frozenset[tuple[str, str]]

    def new_since(self, before: "Census") -> dict[str, list[str]]:
        """By kind, what is there now and was not before; a changed setting is its new value. Settings that came with a module
        of the kernel, which the kernel loads when it is first asked for, have not changed."""
        news = {each.name: getattr(self, each.name) - getattr(before, each.name) for each in fields(self)}
        had = {name for name, _ in before.settings}
        news["settings"] = {(name, value) for name, value in news["settings"] if name in had}
        return {kind: sorted(map(str, found)) for kind, found in news.items() if found}


def take() -> Census:
    others = [Addresses(number) for number in slots.in_use()]
    lines = dict(_command_lines())
    processes = {pid: line for pid, line in lines.items() if _is_ours(pid, lines)}
    return Census(
        processes=frozenset(f"{pid} {line[:120]}" for pid, line in processes.items()),
        namespaces=frozenset(_namespaces(processes)),
        mounts=frozenset(_mounts()),
        cgroups=frozenset(_cgroups({each.cgroup for each in others})),
        links=frozenset(path.name for path in Path("/sys/class/net").iterdir()) - {each.host_link for each in others},
        settings=frozenset(_settings()),
    )


def left_since(before: Census, *, within_s: float = 30.0) -> dict[str, list[str]]:
    """What is new and stays new for `within_s`, at every look: the kernel ends namespaces in the background, and other
    programs on the machine begin and end things of their own."""
    left = take().new_since(before)

    def clean() -> bool:
        nonlocal left
        now = take().new_since(before)
        kept = {kind: [each for each in found if each in now.get(kind, ())] for kind, found in left.items()}
        left = {kind: found for kind, found in kept.items() if found}
        return not left

    wait_until(clean, timeout_s=within_s, poll_s=0.2)
    return left


def _command_lines() -> Iterator[tuple[int, str]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):
                yield int(entry.name), (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")


def _is_ours(pid: int, lines: dict[int, str]) -> bool:
    """A program of a cluster whose owner is this process or has ended: no other living program stands above it."""
    if not _is_marked(lines[pid]):
        return False
    above = list(_ancestors(pid))
    if above[-1:] != [1]:
        return False  # it or one above it has just ended
    return os.getpid() in above or all(_is_marked(lines.get(each, "")) for each in above if each != 1)


def _is_marked(line: str) -> bool:
    return any(mark in line for mark in OURS)


def _ancestors(pid: int) -> Iterator[int]:
    while pid > 1:
        with suppress(OSError):
            stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            pid = int(stat[1])
            yield pid
            continue
        return


def _namespaces(pids: dict[int, str]) -> Iterator[str]:
    """Those that our processes have and this one has not, and network namespaces kept by an open file of this process."""
    for pid in pids:
        for kind in _NAMESPACES:
            with suppress(OSError):
                name = str(Path(f"/proc/{pid}/ns/{kind}").readlink())
                if name != str(Path(f"/proc/self/ns/{kind}").readlink()):
                    yield name
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            target = str(entry.readlink())
            if target.startswith(tuple(f"{kind}:[" for kind in _NAMESPACES)):
                yield target


def _mounts() -> Iterator[str]:
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        yield line.split()[4]


def _cgroups(others: set[str]) -> Iterator[str]:
    for hierarchy in sweep.hierarchies():
        for folder, names, _ in os.walk(hierarchy):
            names[:] = [name for name in names if name not in others]
            yield from (str(Path(folder, name)) for name in names if name.startswith("robotapp"))


def _settings() -> Iterator[tuple[str, str]]:
    root = Path("/proc/sys")
    for folder, _, names in os.walk(root):
        for name in names:
            path = Path(folder, name)
            setting = str(path.relative_to(root))
            if _ALIVE_SETTINGS.match(setting):
                continue
            with suppress(OSError):
                yield setting, path.read_text()
