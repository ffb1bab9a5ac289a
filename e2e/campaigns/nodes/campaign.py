"""Real nodes come and go: whole lives, and owners killed at any moment, each with what it left on the machine."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from campaigns.nodes import machine_census, real_pods
from campaigns.nodes.real_pods import pod
from robotapp_testbed import wait_until
from robotapp_testbed.real import RealNodes

UP_S, DOWN_S = 15.0, 5.0
"""What a cluster of four may take on two idle cores."""
_FOLDER_S = 60.0
_OWNER = """
import sys, time
from robotapp_testbed.real import RealNodes
print("begins", flush=True)
with RealNodes(sys.argv[1].split(","), delays={}) as cp:
    print(cp.run_dir, flush=True)
    time.sleep(120)
"""


@dataclass(frozen=True, slots=True)
class Life:
    up_s: float
    down_s: float
    left: dict[str, list[str]] = field(default_factory=dict)
    """By kind, what was not there before."""


@dataclass(frozen=True, slots=True)
class Kill:
    after_s: float
    was_up: bool
    left: dict[str, list[str]]
    next_up_s: float


def live(names: Sequence[str]) -> Life:
    """Start a cluster, run a pod on every node, end it, count."""
    before = machine_census.take()
    begun_s = time.monotonic()
    plane = RealNodes(names, delays={}).start()
    try:
        up_s = time.monotonic() - begun_s
        run_dir = plane.run_dir
        real_pods.run(plane, "default", *(pod(f"on-{name}", name) for name in names))
    finally:
        begun_s = time.monotonic()
        plane.close()
        down_s = time.monotonic() - begun_s
    plane.close()  # once more is no harm
    return Life(up_s, down_s, _left(before, run_dir))


def kill(names: Sequence[str], after_s: float) -> Kill:
    """Start a cluster in a process of its own, kill that after a while, count, and start the next one."""
    before = machine_census.take()
    command = [sys.executable, "-c", _OWNER, ",".join(names)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        owner.stdout.readline()
        time.sleep(after_s)
        os.kill(owner.pid, signal.SIGKILL)
        told = owner.stdout.readline().strip()
    left = _left(before, Path(told) if told else None)
    begun_s = time.monotonic()
    with RealNodes(names[:1]) as plane:
        assert plane.ready_nodes() == set(names[:1])
        next_up_s = time.monotonic() - begun_s
    return Kill(after_s, bool(told), left, next_up_s)


def _left(before: machine_census.Census, run_dir: Path | None) -> dict[str, list[str]]:
    left = machine_census.left_since(before)
    if run_dir and not wait_until(lambda: not run_dir.exists(), timeout_s=_FOLDER_S):
        left["files"] = [str(run_dir)]
    return left
