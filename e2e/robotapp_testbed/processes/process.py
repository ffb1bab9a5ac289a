"""One operating-system process of ours: started, watched, hurt and ended by its own pid."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Self

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes import guard

_LAUNCH = Path(__file__).with_name("launch.py")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_POLL_S = 0.02
_GROWTH = 1.25
_LOG_TAIL_LINES = 15

# The kernel ends a process when the *thread* that forked it ends (prctl PR_SET_PDEATHSIG), so all are forked by one
# thread that lives as long as the interpreter; a test's own worker threads may come and go.
_SPAWNER = ThreadPoolExecutor(max_workers=1, thread_name_prefix="testbed-spawner")


def wait_until(condition: Callable[[], bool], *, timeout_s: float, poll_s: float = _POLL_S) -> bool:
    """Polls `condition` until it holds, at most `poll_s` apart; False when `timeout_s` passed first."""
    deadline = time.monotonic() + timeout_s
    pauses = growing_pauses(poll_s)
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(next(pauses))
    return True


def growing_pauses(longest_s: float) -> Iterator[float]:
    """Yields the seconds between looks at a condition: a fifth of the time waited so far, as most conditions hold soon."""
    pause_s = min(_POLL_S, longest_s)
    while True:
        yield pause_s
        pause_s = min(pause_s * _GROWTH, longest_s)


def launcher(argv: Sequence[str | Path], *, register: Path | None = None) -> list[str]:
    """The command line that runs `argv` (absolute program path) so that it dies with the calling thread."""
    safeguard = [sys.executable, "-I", "-S", str(_LAUNCH), str(os.getpid()), str(register or "-")]
    return [*safeguard, *map(str, argv)]


def spawn(
    argv: Sequence[str | Path],
    *,
    run_dir: Path,
    log: int,
    env: Mapping[str, str] | None = None,
    cwd: Path | None = None,
) -> subprocess.Popen[bytes]:
    """Start `argv` so that it dies with this process; output goes to descriptor `log`."""
    register = run_dir / guard.REGISTER
    register.mkdir(parents=True, exist_ok=True)
    command = launcher(argv, register=register)

    def start() -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=env,
            cwd=cwd or run_dir,
            start_new_session=True,  # Ctrl-C in the terminal is for the owner, who then ends us in order
        )

    return _SPAWNER.submit(start).result()


def cpu_seconds(pid: int) -> float:
    """User plus system time of a process so far, all threads; 0 when there is none (proc(5), stat fields 14 and 15)."""
    fields = _proc_file(pid, "stat").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S if fields else 0.0


def rss_bytes(pid: int) -> int:
    """Memory of a process in RAM; 0 when there is none."""
    fields = _proc_file(pid, "statm").split()
    return int(fields[1]) * _PAGE_BYTES if fields else 0


def _proc_file(pid: int, name: str) -> str:
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/{name}").read_text()
    return ""


class Process:
    """A program of the testbed. `kill`, `pause`, `resume`, `restart` are the faults tests inject.

    `ready` tells whether the program serves; `wait_ready` polls it. The log file is appended to over restarts.
    """

    def __init__(
        self,
        name: str,
        argv: Sequence[str | Path],
        *,
        run_dir: Path,
        log_path: Path,
        env: Mapping[str, str] | None = None,
        before_start: Callable[[], None] = lambda: None,
        ready: Callable[[], bool] | None = None,
        ready_timeout_s: float = 60.0,
        health_url: str = "",
    ) -> None:
        self.name = name
        self.argv = [str(part) for part in argv]
        self.log_path = log_path
        self.health_url = health_url
        self._run_dir = run_dir
        self._env = dict(env) if env is not None else None
        self._before_start = before_start
        self._ready = ready
        self._ready_timeout_s = ready_timeout_s
        self._popen: subprocess.Popen[bytes] | None = None

    def __repr__(self) -> str:
        state = f"pid {self.pid}" if self.running else f"ended {self.returncode}" if self._popen else "not started"
        return f"<Process {self.name} {state}, log {self.log_path}>"

    @property
    def pid(self) -> int:
        if self._popen is None:
            raise TestbedError(f"{self.name} was never started")
        return self._popen.pid

    @property
    def returncode(self) -> int | None:
        """As subprocess: None while it runs, minus N when signal N ended it."""
        return self._popen.poll() if self._popen else None

    @property
    def running(self) -> bool:
        return self._popen is not None and self._popen.poll() is None

    def start(self) -> Self:
        if self.running:
            return self
        self._before_start()
        with self.log_path.open("ab") as log:
            self._popen = spawn(self.argv, run_dir=self._run_dir, log=log.fileno(), env=self._env)
        return self

    def wait_ready(self, timeout_s: float | None = None, *, needs: Sequence["Process"] = ()) -> Self:
        """Block until the program serves; TestbedError with the log's end when it, or one that it `needs`, ends or it is late."""
        allowed_s = timeout_s or self._ready_timeout_s
        everyone: list[Process] = [*needs, self]

        def settled() -> bool:
            return not all(each.running for each in everyone) or self._ready is None or self._ready()

        in_time = wait_until(settled, timeout_s=allowed_s)
        for each in everyone:
            if not each.running:
                raise TestbedError(f"{each.name} ended with {each.returncode} while starting. {each.log_tail()}")
        if not in_time:
            raise TestbedError(f"{self.name} was not ready after {allowed_s:.0f} s. {self.log_tail()}")
        return self

    def kill(self) -> None:
        """SIGKILL, then wait until it is gone."""
        self.send(signal.SIGKILL)
        self.wait()

    def stop(self, timeout_s: float = 30.0) -> int | None:
        """SIGTERM (to a paused program as well), SIGKILL after `timeout_s`; the exit status."""
        self.send(signal.SIGTERM)
        self.send(signal.SIGCONT)
        try:
            return self.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.kill()
            return self.returncode

    def pause(self) -> None:
        """SIGSTOP: the process stands still but keeps its sockets, like a machine that hangs."""
        self.send(signal.SIGSTOP)

    def resume(self) -> None:
        self.send(signal.SIGCONT)

    def restart(self) -> Self:
        """SIGKILL what runs, start again with the same arguments, wait until it serves."""
        self.kill()
        return self.start().wait_ready()

    def send(self, number: signal.Signals) -> None:
        if self._popen is not None and self._popen.poll() is None:
            self._popen.send_signal(number)

    def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait for the end; subprocess.TimeoutExpired when it is late."""
        if self._popen is None:
            return None
        code = self._popen.wait(timeout_s)
        (self._run_dir / guard.REGISTER / str(self._popen.pid)).unlink(missing_ok=True)
        return code

    def cpu_seconds(self) -> float:
        """User plus system time so far, all threads; 0 when it does not run."""
        return cpu_seconds(self.pid)

    def rss_bytes(self) -> int:
        return rss_bytes(self.pid)

    def log_text(self) -> str:
        with suppress(FileNotFoundError):
            return self.log_path.read_text(errors="replace")
        return ""

    def log_tail(self) -> str:
        """What it said last, as the end of a sentence."""
        tail = "\n".join(self.log_text().splitlines()[-_LOG_TAIL_LINES:])
        return f"The end of {self.log_path}:\n{tail}"
