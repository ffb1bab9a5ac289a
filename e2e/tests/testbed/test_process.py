"""Processes and the two safeguards against orphans, with sleeping shell scripts."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path

import pytest

from robotapp_testbed import Process, TestbedError, wait_until
from robotapp_testbed.processes import guard
from robotapp_testbed.processes.process import growing_pauses

SHELL = "/bin/sh"


def alive(pid: int) -> bool:
    return guard.start_time(pid) is not None


def state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


class Stage:
    def __init__(self, folder: Path) -> None:
        self.run_dir = folder / "run"
        self.run_dir.mkdir()
        self.processes: list[Process] = []

    def process(self, script: str, **options: object) -> Process:
        process = Process(
            "sleeper",
            [SHELL, "-c", script],
            run_dir=self.run_dir,
            log_path=self.run_dir / "log",
            **options,  # type: ignore[arg-type]  # passed on
        )
        self.processes.append(process)
        return process

    def registered(self) -> set[str]:
        return {path.name for path in (self.run_dir / guard.REGISTER).iterdir()}


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    made = Stage(tmp_path)
    yield made
    for process in made.processes:
        process.kill()


def test_a_killed_process_is_gone_and_no_longer_registered(stage: Stage) -> None:
    process = stage.process("exec sleep 60").start()
    assert wait_until(lambda: stage.registered() == {str(process.pid)}, timeout_s=60)
    process.kill()
    assert not process.running
    assert process.returncode == -signal.SIGKILL
    assert stage.registered() == set()


def test_stop_asks_first(stage: Stage) -> None:
    process = stage.process("trap 'echo asked; exit 7' TERM; echo up; while :; do sleep 0.05; done").start()
    assert wait_until(lambda: "up" in process.log_text(), timeout_s=60)
    assert process.stop() == 7
    assert process.log_text().endswith("asked\n")


def test_stop_kills_what_does_not_listen(stage: Stage) -> None:
    process = stage.process("trap '' TERM; echo up; while :; do sleep 0.05; done").start()
    assert wait_until(lambda: "up" in process.log_text(), timeout_s=60)
    assert process.stop(timeout_s=0.2) == -signal.SIGKILL


def test_a_paused_process_stands_still_until_it_is_resumed(stage: Stage) -> None:
    process = stage.process("exec sleep 60").start()
    process.pause()
    assert wait_until(lambda: state_of(process.pid) == "T", timeout_s=60)
    process.resume()
    assert wait_until(lambda: state_of(process.pid) == "S", timeout_s=60)


@pytest.mark.parametrize("end", ["stop", "kill"])
def test_a_paused_process_can_be_ended(end: str, stage: Stage) -> None:
    process = stage.process("exec sleep 60").start()
    process.pause()
    getattr(process, end)()
    assert not process.running


def test_a_restart_is_another_process_with_the_same_log(stage: Stage) -> None:
    process = stage.process("echo begun; exec sleep 60").start()
    assert wait_until(lambda: "begun" in process.log_text(), timeout_s=60)
    before = process.pid
    process.restart()
    assert process.pid != before
    assert wait_until(lambda: process.log_text() == "begun\nbegun\n", timeout_s=60)


def test_starting_twice_starts_once(stage: Stage) -> None:
    process = stage.process("exec sleep 60").start()
    assert process.start().pid == process.pid
    assert len(stage.registered()) <= 1


def test_ready_is_waited_for(stage: Stage) -> None:
    flag = stage.run_dir / "flag"
    process = stage.process(f"sleep 0.2; touch {flag}; exec sleep 60", ready=flag.exists)
    process.start().wait_ready()
    assert flag.exists()


def test_ready_once_is_ready(stage: Stage) -> None:
    answers = iter([False, True])
    stage.process("exec sleep 60", ready=lambda: next(answers)).start().wait_ready()


def test_a_program_that_ends_while_starting_is_reported_with_its_last_words(stage: Stage) -> None:
    process = stage.process("echo port taken >&2; exit 3", ready=lambda: False).start()
    with pytest.raises(TestbedError, match=r"ended with 3 while starting(.|\n)*port taken"):
        process.wait_ready()


def test_who_waits_for_a_program_hears_at_once_of_the_end_of_one_that_it_needs(stage: Stage) -> None:
    needed = stage.process("echo no space left; exit 4").start()
    process = stage.process("exec sleep 60", ready=lambda: False).start()
    with pytest.raises(TestbedError, match=r"(?s)sleeper ended with 4 while starting.*no space left"):
        process.wait_ready(needs=[needed])
    assert process.running


def test_a_program_that_is_late_is_reported(stage: Stage) -> None:
    process = stage.process("exec sleep 60", ready=lambda: False).start()
    with pytest.raises(TestbedError, match="not ready after 0 s"):
        process.wait_ready(0.1)


def test_cpu_and_memory_are_those_of_the_process(stage: Stage) -> None:
    process = stage.process("while :; do :; done").start()
    assert wait_until(lambda: process.cpu_seconds() > 0.05, timeout_s=60)
    assert 100_000 < process.rss_bytes() < 50_000_000
    process.kill()
    assert (process.cpu_seconds(), process.rss_bytes()) == (0.0, 0)


def test_a_process_that_was_never_started_says_so(stage: Stage) -> None:
    process = stage.process("exec sleep 60")
    with pytest.raises(TestbedError, match="never started"):
        _ = process.pid
    assert not process.running
    assert "not started" in repr(process)


def test_the_thread_that_started_a_process_may_end(stage: Stage) -> None:
    process = stage.process("exec sleep 60")
    thread = threading.Thread(target=process.start)
    thread.start()
    thread.join()
    assert wait_until(lambda: state_of(process.pid) == "S", timeout_s=60)
    assert not wait_until(lambda: not process.running, timeout_s=0.3)


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


def test_a_damaged_program_is_named_with_what_to_do(tmp_path: Path) -> None:
    damaged = tmp_path / "etcd"
    damaged.write_bytes(b"\x7fELF")
    damaged.chmod(0o755)
    launch = Path(guard.__file__).with_name("launch.py")
    command = [sys.executable, "-I", "-S", str(launch), str(os.getpid()), "-", str(damaged)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith(f"{damaged} cannot be run (Exec format error): ")


def test_looks_at_a_condition_are_close_together_at_first_and_never_further_apart_than_asked() -> None:
    pauses = list(islice(growing_pauses(0.5), 30))
    assert pauses[0] == 0.02
    assert all(one <= other for one, other in pairwise(pauses))
    assert pauses[-1] == 0.5
    assert set(islice(growing_pauses(0.01), 30)) == {0.01}
