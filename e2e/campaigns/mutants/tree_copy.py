"""A copy of the tree with a Python environment of its own, so that tests and the programs they start have the fault."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from campaigns.mutants.first_failure import REPORT

PACKAGES: Final = (
    *("robotapp_api", "robotapp_client", "robotapp_claims", "robotapp_operator", "robotapp_scheduler"),
    *("robotapp_agent", "robotapp_cli", "robotapp_console", "rigel_bridge", "ros_profile"),
    *("robotapp_testbed", "campaigns", "suite"),
)
PROGRAM: Final = "robotapp-operator"
"""One of the programs that an installation makes; all have the same first line."""
ENDING_S: Final = 120.0
"""How long tests that ran out of time may take to end their control plane."""
_ITS_OWN: Final = (
    *("VIRTUAL_ENV", "PYTHONPATH", "PYTHONPYCACHEPREFIX", "PYTHONDONTWRITEBYTECODE"),
    "PYTEST_XDIST_WORKER",  # the copy's pytest is no worker of the one that runs this
)
_FAILED: Final = frozenset({1, 2})
"""Exit statuses of pytest when tests failed, or could not be imported."""
_NO_TESTS: Final = 5


class WrongEnvironmentError(RuntimeError):
    """The copy uses packages of another tree, so its tests would prove nothing."""


class PytestRun(NamedTuple):
    """`failed`: the first failed test, "" when all passed. `is_over`: the tests came to an end in the time they had."""

    failed: str
    is_over: bool
    seconds: float
    tail: str = ""
    """The last lines of the output, where tests could not be started."""


@dataclass(frozen=True, slots=True)
class TreeCopy:
    """A clone of the repository at `path`."""

    path: Path

    @classmethod
    def create(cls, source: Path, path: Path) -> "TreeCopy":
        """Clones the newest commit and makes the environment. Changes that are not committed are not in it."""
        _run(["git", "clone", "--quiet", "--local", "--no-tags", str(source), str(path)], cwd=source)
        commit = _run(["git", "rev-parse", "HEAD"], cwd=source).strip()
        _run(["git", "checkout", "--quiet", "--detach", commit], cwd=path)
        copy = cls(path)
        _run(["bash", "-c", ". scripts/environment"], cwd=path, env=copy.environment())
        copy.prove_it_is_used()
        return copy

    @property
    def commit(self) -> str:
        return _run(["git", "rev-parse", "--short=12", "HEAD"], cwd=self.path).strip()

    def environment(self) -> dict[str, str]:
        """Returns the variables of the copy's programs: none that lead back to another environment."""
        variables = {key: value for key, value in os.environ.items() if key not in _ITS_OWN}
        variables["PATH"] = os.pathsep.join([str(self._programs), variables.get("PATH", "")])
        return variables

    @property
    def _programs(self) -> Path:
        return self.path / ".venv" / "bin"

    def prove_it_is_used(self) -> None:
        """Raises `WrongEnvironmentError` unless the copy's Python and programs have every package from the copy, also with -I."""
        script = "import importlib, json, sys; print(json.dumps([importlib.import_module(n).__file__ for n in sys.argv[1:]]))"
        python, program = self._programs / "python", self._programs / PROGRAM
        answer = _run([str(python), "-I", "-c", script, *PACKAGES], cwd=self.path, env=self.environment())
        files: list[str] = json.loads(answer)
        strangers = [file for file in files if not Path(file).resolve().is_relative_to(self.path.resolve())]
        if strangers:
            raise WrongEnvironmentError(f"the copy in {self.path} uses {', '.join(strangers)}")
        if str(self._programs) not in program.read_text(encoding="utf-8").splitlines()[0]:
            raise WrongEnvironmentError(f"{program} is run by another Python than that of the copy")

    def run_tests(
        self,
        tests: Sequence[str],
        *,
        most_s: float,
        options: Sequence[str] = (),
        variables: Mapping[str, str] = MappingProxyType({}),
    ) -> PytestRun:
        """Runs pytest in the copy, with these environment variables besides, until a test fails or `most_s` are over."""
        report = self.path / ".venv" / "failed-tests"
        report.write_text("", encoding="utf-8")
        command = [str(self._programs / "python"), "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:randomly"]
        command += ["-p", "campaigns.mutants.first_failure", *options, *tests]
        started_s = time.monotonic()
        with (self.path / ".venv" / "output").open("w+b") as output:
            environment = self.environment() | {**variables, REPORT: str(report)}
            # A group of its own and no session: the leader of a session is hung up by a test that closes a terminal.
            process = subprocess.Popen(
                command,
                cwd=self.path,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                process_group=0,
            )
            is_over = _wait(process, most_s)
            output.seek(0)
            lines = output.read().decode(errors="replace").splitlines()
        seconds = time.monotonic() - started_s
        failed = next(iter(report.read_text(encoding="utf-8").splitlines()), "")
        if not is_over:
            return PytestRun(failed, bool(failed), seconds)
        if process.returncode in {0, _NO_TESTS}:
            return PytestRun("", True, seconds)
        if process.returncode in _FAILED and failed:
            return PytestRun(failed, True, seconds)
        last = f"pytest ended with status {process.returncode}"
        return PytestRun("(pytest does not start)", True, seconds, "\n".join([*lines[-15:], last]))


def _wait(process: subprocess.Popen[bytes], most_s: float) -> bool:
    """Waits for the end and returns whether the process ended by itself in time; else ends it as Ctrl-C does."""
    try:
        process.wait(most_s)
    except subprocess.TimeoutExpired:
        _end(process)
        return False
    except BaseException:
        _end(process)
        raise
    return True


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends the process, and its group where it does not end its own children in time."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(ENDING_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _run(command: Sequence[str], *, cwd: Path, env: Mapping[str, str] | None = None) -> str:
    """Returns the output. Raises `RuntimeError` with the errors of a command that fails."""
    answer = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if answer.returncode != 0:
        raise RuntimeError(f"{' '.join(command)[:200]} failed: {answer.stderr.strip()[-2000:]}")
    return answer.stdout
