"""A set of namespaces (network, mounts, host name, IPC, processes) and the programs in it.

All of it hangs on one process: when that ends, the kernel ends everything inside and drops its mounts and links.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from robotapp_testbed.failures import CommandError, TestbedError
from robotapp_testbed.processes.process import Process, cpu_seconds, rss_bytes, wait_until
from robotapp_testbed.real import iproute
from robotapp_testbed.real.scripts import enter, hold

_UP_S = 60.0
_COMMAND_S = 60.0


@dataclass(frozen=True, slots=True)
class Plan:
    """What differs inside from outside. Paths of `sysctls` and `pretended` are below /proc/sys."""

    hostname: str
    overlays: Sequence[str] = ()
    """Folders that can be written inside without changing the host's."""
    binds: Sequence[tuple[Path, str]] = ()
    """(folder or file of the host, place inside), with all that is mounted below: made in an overlay where it does not exist."""
    sysctls: Mapping[str, str] = field(default_factory=dict)
    pretended: Sequence[str] = ()
    """Settings of the whole machine that programs inside may set without any effect: they write to a file."""

    def document(self, folder: Path) -> dict[str, Any]:
        """For hold.py, with `folder` for the overlays' layers and the pretended settings."""
        mounts: list[dict[str, str]] = []
        for target in self.overlays:
            layers = {kind: str(folder / kind / target.strip("/").replace("/", "-")) for kind in ("upper", "work")}
            mounts.append({"kind": "overlay", "source": target, "target": target, **layers})
        mounts += [{"kind": "bind", "source": str(source), "target": target} for source, target in self.binds]
        pretended = {name: str(folder / "sysctls" / name.replace("/", ".")) for name in self.pretended}
        return {"hostname": self.hostname, "mounts": mounts, "sysctls": dict(self.sysctls), "pretended": pretended}


class Inside(Process):
    """A program in a box. Its pid is that of the script that entered for it; faults and figures are of the program."""

    def pause(self) -> None:
        self._signal_program(signal.SIGSTOP)

    def resume(self) -> None:
        self._signal_program(signal.SIGCONT)

    def cpu_seconds(self) -> float:
        return sum(map(cpu_seconds, self.program_pids()))

    def rss_bytes(self) -> int:
        return sum(map(rss_bytes, self.program_pids()))

    def program_pids(self) -> list[int]:
        """The host's pid of the program, if it runs."""
        return children(self.pid)

    def _signal_program(self, number: signal.Signals) -> None:
        for pid in self.program_pids():
            with suppress(ProcessLookupError):
                os.kill(pid, number)


class Box:
    """`folder` keeps its files, `run_dir` registers its process with the guard, as for every program of the testbed."""

    def __init__(self, name: str, plan: Plan, *, folder: Path, run_dir: Path, logs_dir: Path) -> None:
        self.name = name
        self._plan = plan
        self._folder = folder
        self._run_dir = run_dir
        self._logs_dir = logs_dir
        self._pid_file = folder / "pid"
        self._pid = 0
        self.process = Process(
            f"box@{name}",
            [sys.executable, "-I", "-S", hold.__file__, folder / "plan.json"],
            run_dir=run_dir,
            log_path=logs_dir / f"box@{name}.log",
            ready=self._pid_file.exists,
            ready_timeout_s=_UP_S,
        )

    @property
    def pid(self) -> int:
        """Process 1 of the box, as the host counts."""
        if not self._pid:
            raise TestbedError(f"{self.name} is not running")
        return self._pid

    @property
    def running(self) -> bool:
        return self.process.running

    @property
    def netns(self) -> str:
        """A path for setns(2), for as long as the box runs."""
        return f"/proc/{self.pid}/ns/net"

    def start(self) -> Self:
        self._write_plan()
        self._pid_file.unlink(missing_ok=True)
        self.process.start().wait_ready()
        self._pid = int(self._pid_file.read_text())
        return self

    def kill(self) -> None:
        """End everything inside at once and wait until the kernel is done with it."""
        self.process.kill()
        if self._pid and not wait_until(lambda: not Path(f"/proc/{self._pid}").exists(), timeout_s=_UP_S):
            raise TestbedError(f"processes of {self.name} do not end: see `ps` for children of pid {self._pid}")
        self._pid = 0

    def program(self, name: str, argv: Sequence[str | Path], **options: Any) -> Inside:
        """A program inside, not started yet; `options` are those of Process."""
        return Inside(
            f"{name}@{self.name}",
            self.entering(argv),
            run_dir=self._run_dir,
            log_path=self._logs_dir / f"{name}@{self.name}.log",
            **options,
        )

    def entering(self, argv: Sequence[str | Path]) -> list[str]:
        """The command line that runs `argv` (absolute program path) inside."""
        return [sys.executable, "-I", "-S", enter.__file__, str(self.pid), *map(str, argv)]

    def run(self, *argv: str | Path, stdin: str = "", check: bool = True) -> str:
        """Standard output of a command run inside to its end; CommandError when it fails."""
        return _output(self.entering(argv), stdin=stdin, check=check)

    def ip(self, *lines: str) -> None:
        """Commands for iproute2 in the box's network namespace, as one batch. Pids in them are the host's."""
        iproute.batch(lines, inside_of=self.pid)

    def _write_plan(self) -> None:
        document = {**self._plan.document(self._folder), "pid_file": str(self._pid_file)}
        for each in document["mounts"]:
            for kind in ("upper", "work") if each["kind"] == "overlay" else ("source",):
                if not Path(each[kind]).exists():  # a file such as /dev/null does
                    Path(each[kind]).mkdir(parents=True)
        for name, path in document["pretended"].items():
            current = Path("/proc/sys", name)
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(current.read_text() if current.exists() else "")
        (self._folder / "plan.json").write_text(json.dumps(document))


def children(pid: int) -> list[int]:
    with suppress(FileNotFoundError, ProcessLookupError):
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def _output(argv: Sequence[str], *, stdin: str, check: bool) -> str:
    done = subprocess.run(argv, input=stdin, capture_output=True, text=True, timeout=_COMMAND_S, check=False)
    if check and done.returncode != 0:
        raise CommandError(argv, done.returncode, done.stdout, done.stderr)
    return done.stdout
