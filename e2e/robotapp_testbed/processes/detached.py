"""Clusters that outlive the command that started them: a holder process owns each, a state file tells about it.

Whether one runs is decided by the lock its holder keeps, not by the file: a lock ends with its process, a file does not.
"""

import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self, TextIO

from robotapp_testbed.binaries.cache import cache_home
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes import guard
from robotapp_testbed.processes.process import wait_until

_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")
_UP_S = 240.0  # several real nodes with our programs as pods take minutes on a machine that has other work
_DOWN_S = 45.0
_LOOKED_AT_S = 1.0  # a look at the lock holds it for a moment
_LOG_TAIL_LINES = 12


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that owns a cluster; its pid alone could be another process by now."""

    pid: int
    start: str

    @classmethod
    def this(cls) -> Self:
        return cls(os.getpid(), guard.start_time(os.getpid()) or "")

    @property
    def lives(self) -> bool:
        return guard.start_time(self.pid) == self.start

    def send(self, number: signal.Signals) -> None:
        with suppress(ProcessLookupError):
            if self.lives:
                os.kill(self.pid, number)


@dataclass(frozen=True, slots=True)
class State:
    """What the commands need to know about a running cluster."""

    holder_pid: int
    server_url: str
    run_dir: str
    processes: dict[str, int]
    scheduler_url: str = ""
    """Of our scheduler where it runs as a program of this machine."""

    def kubeconfig(self, identity: str) -> Path:
        return Path(self.run_dir, "kubeconfigs", f"{identity}.yaml")


class Cluster:
    """One named detached cluster."""

    def __init__(self, name: str = "default", *, root: Path | None = None) -> None:
        if not _NAME.fullmatch(name):
            raise TestbedError(f"{name!r} is no cluster name: use up to 40 small letters, digits and dashes")
        self.name = name
        self._root = root or cache_home() / "clusters"
        self._file = self._root / f"{name}.json"
        self._lock = self._root / f"{name}.lock"
        self.log_path = self._root / f"{name}.log"

    def state(self) -> State | None:
        """None unless it runs and is ready.

        The file of a holder that was killed stays until the next one, which has the lock by then, removes it.
        """
        holder = self.holder()
        if holder is None or not holder.lives:
            return None
        try:
            state = State(**json.loads(self._file.read_text()))
        except FileNotFoundError:
            return None
        return state if state.holder_pid == holder.pid else None

    def holder(self) -> Holder | None:
        """Who holds it, from the lock's file; None when nobody does."""
        with suppress(FileNotFoundError, ValueError, TypeError):  # no file, or nothing in it yet
            holder = Holder(**json.loads(self._lock.read_text()))
            return holder if self._is_held() else None
        return None

    def up(self, arguments: Sequence[str]) -> State:
        """Start the holder (`python -m robotapp_testbed up --hold …`) unless one runs, wait until the cluster serves."""
        self._root.mkdir(parents=True, exist_ok=True)
        state = self.state()
        if state:
            return state
        with self.log_path.open("wb") as log:
            holder = subprocess.Popen(
                [sys.executable, "-m", "robotapp_testbed", "up", "--hold", f"--name={self.name}", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        try:
            # A holder that lost a race against another `up` ends; then the other one's cluster is waited for.
            wait_until(
                lambda: self.state() is not None or (holder.poll() is not None and not self._is_held()), timeout_s=_UP_S
            )
        except BaseException:  # Ctrl-C: else a cluster that nobody expects would come up a moment later
            _end(holder)
            raise
        state = self.state()
        if state is None:
            _end(holder)
            tail = "\n".join(self.log_path.read_text(errors="replace").splitlines()[-_LOG_TAIL_LINES:])
            raise TestbedError(
                f"{tail}\nthe cluster {self.name!r} did not start: the whole story is in {self.log_path}"
            )
        holder.returncode = 0  # it is meant to go on without us: no warning about an unfinished child
        return state

    def hold(
        self, plane: AbstractContextManager[ControlPlane], *, prepare: Callable[[ControlPlane, ExitStack], None]
    ) -> None:
        """Run `plane`, `prepare` it (the stack ends what that started), publish it and keep it until SIGTERM or SIGINT.

        One that comes while the cluster starts is a KeyboardInterrupt, which ends in order what has been started.
        """
        ended = threading.Event()
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with self._holding(), plane as cp, ExitStack() as stack:
            prepare(cp, stack)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: ended.set())
            self._publish(cp)
            stack.callback(self._file.unlink, missing_ok=True)
            ended.wait()

    def down(self, *, within_s: float = _DOWN_S) -> bool:
        """End it, also while it starts, and wait until nothing of it is left; False when it did not run.

        It is killed after `within_s`.
        """
        holder, state = self.holder(), self.state()
        if holder is None:
            return False
        holder.send(signal.SIGTERM)
        if not wait_until(lambda: not holder.lives, timeout_s=within_s):
            holder.send(signal.SIGKILL)  # its guard cleans up
        run_dir = Path(state.run_dir) if state else None
        if not wait_until(lambda: not (holder.lives or (run_dir and run_dir.exists())), timeout_s=_DOWN_S):
            raise TestbedError(f"{run_dir or holder} could not be removed: look there, then remove it")
        return True

    def _publish(self, cp: ControlPlane) -> None:
        state = State(
            holder_pid=os.getpid(),
            server_url=cp.server_url,
            run_dir=str(cp.run_dir),
            processes=cp.pids(),
            scheduler_url=cp.process("scheduler").health_url if "scheduler" in cp.pids() else "",
        )
        partial = self._file.with_suffix(".partial")
        partial.write_text(json.dumps(asdict(state), indent=1))
        partial.replace(self._file)

    def _is_held(self) -> bool:
        try:
            with self._lock.open() as file:
                fcntl.flock(
                    file, fcntl.LOCK_SH | fcntl.LOCK_NB
                )  # shared: two who look do not take each other for the holder
        except FileNotFoundError:
            return False
        except BlockingIOError:
            return True
        return False

    @contextmanager
    def _holding(self) -> Iterator[None]:
        self._root.mkdir(parents=True, exist_ok=True)
        with self._lock.open("a+") as file:  # what is in it is the holder's until we are that
            if not wait_until(lambda: _try_lock(file), timeout_s=_LOOKED_AT_S):
                raise TestbedError(f"the cluster {self.name!r} runs already")
            file.truncate(0)
            file.write(json.dumps(asdict(Holder.this())))
            file.flush()
            self._file.unlink(missing_ok=True)  # of an earlier holder that was killed
            yield


def _end(holder: "subprocess.Popen[bytes]") -> None:
    """In order if it can: what it had started goes with it either way."""
    holder.terminate()
    try:
        holder.wait(_DOWN_S)
    except subprocess.TimeoutExpired:
        holder.kill()
        holder.wait()


def _try_lock(file: TextIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
