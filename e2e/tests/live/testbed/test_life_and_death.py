"""Nothing is left behind, whatever ends a control plane; several live side by side."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from robotapp_testbed import ControlPlane, TestbedError, wait_until
from robotapp_testbed.processes import guard

pytestmark = pytest.mark.live

OWNER = """
import sys, time
from robotapp_testbed import ControlPlane
plane = ControlPlane().start()
print(plane.run_dir, *plane.pids().values(), flush=True)
time.sleep(600)
"""


def alive(pid: int) -> bool:
    return guard.start_time(pid) is not None


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_a_killed_owner_leaves_no_process_and_no_file(number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(OWNER)], stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        run_dir, *pids = owner.stdout.readline().split()
        assert len(pids) == 4
        assert all(alive(int(pid)) for pid in pids)
        os.kill(owner.pid, number)
        owner.wait()
    assert wait_until(lambda: not any(alive(int(pid)) for pid in pids), timeout_s=60)
    assert wait_until(lambda: not Path(run_dir).exists(), timeout_s=60)


def test_two_control_planes_live_side_by_side(control_plane: ControlPlane) -> None:
    with ControlPlane(kwok=False) as other:
        other.kubectl("create", "configmap", "only-there")
        assert "only-there" in other.kubectl("get", "configmaps")
        assert "only-there" not in control_plane.kubectl("get", "configmaps")
        assert other.server_url != control_plane.server_url
        run_dir, pids = other.run_dir, other.pids().values()
    assert not run_dir.exists()
    assert not any(map(alive, pids))
    assert control_plane.api.get("/readyz") == "ok"


def test_a_start_that_fails_leaves_nothing_and_shows_the_log() -> None:
    plane = ControlPlane(extra_args={"kube-apiserver": ["--no-such-flag"]})
    with pytest.raises(
        TestbedError, match=r"kube-apiserver ended with 1 while starting(.|\n)*unknown flag: --no-such-flag"
    ):
        plane.start()
    assert plane.pids() == {}
    with pytest.raises(TestbedError, match="not started"):
        _ = plane.run_dir


def test_logs_can_outlive_the_control_plane(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with ControlPlane(kwok=False, controller_manager=False) as plane:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        kept = plane.keep_logs()
    assert kept.is_relative_to(tmp_path)
    assert "kube-apiserver.log" in {path.name for path in kept.iterdir()}
