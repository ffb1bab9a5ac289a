"""The two safeguards against orphans, with shell scripts that do not end by themselves."""

import os
import signal
import subprocess
import sys
import textwrap
from itertools import islice, pairwise
from pathlib import Path

import pytest

from robotapp_testbed import wait_until
from robotapp_testbed.processes import guard
from robotapp_testbed.processes.process import growing_pauses


def alive(pid: int) -> bool:
    return guard.start_time(pid) is not None


OWNER = """
import sys, time
from pathlib import Path
from robotapp_testbed.control_plane.controlplane import start_guard
from robotapp_testbed.processes.process import Process
run_dir = Path(sys.argv[1])
guard = start_guard(run_dir)
processes = [Process(str(n), ["/bin/sh", "-c", "trap '' TERM HUP; while :; do sleep 0.05; done"], run_dir=run_dir, log_path=run_dir / "log").start() for n in range(3)]
print(guard.pid, *(process.pid for process in processes), flush=True)
time.sleep(60)
"""


def owned(run_dir: Path) -> tuple[subprocess.Popen[str], int, list[int]]:
    """An owner in another process: it, its guard's pid, its programs' pids."""
    run_dir.mkdir()
    owner = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(OWNER), str(run_dir)], stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout is not None
    with owner.stdout:
        guard_pid, *pids = map(int, owner.stdout.readline().split())
    return owner, guard_pid, pids


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_nothing_is_left_when_the_owner_ends_by_a_signal(number: signal.Signals, tmp_path: Path) -> None:
    owner, guard_pid, pids = owned(tmp_path / "run")
    os.kill(owner.pid, number)
    owner.wait()
    assert wait_until(lambda: not any(map(alive, [guard_pid, *pids])), timeout_s=60)
    assert not (tmp_path / "run").exists()


def test_nothing_runs_on_when_owner_and_guard_are_killed_together(tmp_path: Path) -> None:
    owner, guard_pid, pids = owned(tmp_path / "run")
    os.kill(guard_pid, signal.SIGKILL)
    os.kill(owner.pid, signal.SIGKILL)
    owner.wait()
    assert wait_until(lambda: not any(map(alive, pids)), timeout_s=60)


def test_the_guard_spares_a_process_that_only_got_the_same_pid(tmp_path: Path) -> None:
    register = tmp_path / guard.REGISTER
    register.mkdir()
    with subprocess.Popen(["/bin/sleep", "60"]) as stranger:
        (register / str(stranger.pid)).write_text("1")  # registered by a process that started at another time
        assert guard.kill_registered(register) == 0
        assert stranger.poll() is None
        (register / str(stranger.pid)).write_text(str(guard.start_time(stranger.pid)))
        assert guard.kill_registered(register) == 1
        assert stranger.wait() == -signal.SIGKILL
    assert guard.kill_registered(register) == 0


def test_a_program_whose_owner_is_already_gone_does_not_start(tmp_path: Path) -> None:
    launch = Path(guard.__file__).with_name("launch.py")
    command = [sys.executable, "-I", "-S", str(launch), "1", str(tmp_path), "/bin/echo", "started"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode != 0
    assert "gone" in result.stderr
    assert result.stdout == ""


def test_looks_at_a_condition_are_close_together_at_first_and_never_further_apart_than_asked() -> None:
    pauses = list(islice(growing_pauses(0.5), 30))
    assert pauses[0] == 0.02
    assert all(one <= other for one, other in pairwise(pauses))
    assert pauses[-1] == 0.5
    assert set(islice(growing_pauses(0.01), 30)) == {0.01}
