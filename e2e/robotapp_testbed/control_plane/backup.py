"""Backups of the control plane's etcd, and going back to one while everything else runs.

A backup is a copy of etcd's data directory, made while etcd stands still. Restored, it has the same objects, uids and resource
versions, and versions are given a second time: what `etcdutl snapshot restore` does without `--bump-revision`.
"""

import shutil
from pathlib import Path

from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.control_plane.servers import Program


def take_backup(cp: ControlPlane, name: str = "backup") -> Path:
    """Copies etcd's data directory; returns the copy, which ends with the control plane."""
    copy = cp.run_dir / name
    etcd = cp.process(Program.ETCD)
    etcd.pause()
    try:
        shutil.copytree(_data(cp), copy)
    finally:
        etcd.resume()
    return copy


def restore_backup(cp: ControlPlane, backup: Path) -> None:
    """Replaces etcd's data by a backup and starts etcd, API server and Kubernetes' own clients again, as one has to.

    The product's processes run on.
    """
    cp.process(Program.API).kill()
    cp.process(Program.ETCD).kill()
    shutil.rmtree(_data(cp))
    shutil.copytree(backup, _data(cp))
    cp.process(Program.ETCD).start()
    cp.process(Program.API).start().wait_ready(needs=[cp.process(Program.ETCD)])
    running = cp.pids()
    for program in (Program.CONTROLLER_MANAGER, Program.KWOK, Program.SCHEDULER):
        if program in running:
            cp.process(program).restart()


def _data(cp: ControlPlane) -> Path:
    return cp.run_dir / "etcd"
