"""The cgroup folders of the nodes: one per node below one per cluster, in every hierarchy."""

from contextlib import suppress
from pathlib import Path

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.real.scripts import sweep

_COPIED = ("cpuset.cpus", "cpuset.mems")
_CONTROLLERS = ("cpu", "cpuset", "hugetlb", "io", "memory", "pids")
"""A kubelet refuses a root that lacks one it knows (all of these but io) when the machine has it."""
_PERIOD_US = 100_000
"""The period of the quota that Kubernetes writes for `limits.cpu`."""


def create(name: str, *, root: Path = sweep.CGROUPS) -> None:
    """Make `name` (may be nested) in every hierarchy, usable by a kubelet as its root. May be repeated."""
    for hierarchy in sweep.hierarchies(root):
        folder = hierarchy
        for part in Path(name).parts:
            _delegate(folder)
            folder = folder / part
            folder.mkdir(exist_ok=True)
            _inherit(folder)


def limit_cpu(name: str, cores: float, *, root: Path = sweep.CGROUPS) -> None:
    """Caps the CPU that everything in the folder `name` uses together, as `limits.cpu` does for a container."""
    quota_us = round(cores * _PERIOD_US)
    for folder in (hierarchy / name for hierarchy in sweep.hierarchies(root)):
        if (folder / "cpu.cfs_quota_us").exists():
            (folder / "cpu.cfs_period_us").write_text(str(_PERIOD_US))
            (folder / "cpu.cfs_quota_us").write_text(str(quota_us))
            return
        if (folder / "cpu.max").exists():
            (folder / "cpu.max").write_text(f"{quota_us} {_PERIOD_US}")
            return
    raise TestbedError(f"no hierarchy below {root} has a control group {name} whose CPU can be limited")


def _inherit(folder: Path) -> None:
    """With v1 a new cpuset is empty, and a process could not even join it."""
    for name in _COPIED:
        own, above = folder / name, folder.parent / name
        if own.exists() and above.exists() and not own.read_text().strip():
            own.write_text(above.read_text())


def _delegate(folder: Path) -> None:
    """With v2 a folder's children have the controllers it hands down."""
    control = folder / "cgroup.subtree_control"
    if not control.exists():
        return
    offered = (folder / "cgroup.controllers").read_text().split()
    handed_down = control.read_text().split()
    for controller in _CONTROLLERS:
        if controller in offered and controller not in handed_down:
            with suppress(OSError):  # the kubelet names a controller it lacks better than we could
                control.write_text(f"+{controller}")
