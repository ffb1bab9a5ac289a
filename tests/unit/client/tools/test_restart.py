"""How a process starts again, and when it leaves that to others."""

import os
import subprocess
import sys

import pytest

from robotapp_client.tools.restart import RESTORED, STARTED_AGAIN, start_again

PROGRAM = """
import os, sys
from robotapp_client.tools.restart import STARTED_AGAIN, start_again
print(os.getpid(), STARTED_AGAIN in os.environ)
sys.exit(start_again())
"""


class ProcessReplacedError(Exception):
    """Stands for the end of this program: `os.execv` does not return."""


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The command lines by which this process was replaced."""
    lines: list[list[str]] = []

    def execv(_path: str, line: list[str]) -> None:
        lines.append(line)
        raise ProcessReplacedError

    monkeypatch.setattr("os.execv", execv)
    monkeypatch.setattr("os.environ", dict(os.environ))
    os.environ.pop(STARTED_AGAIN, None)
    return lines


def restart_at(now_s: float) -> int | None:
    """The exit status, or None when the process was replaced."""
    try:
        return start_again(clock=lambda: now_s)
    except ProcessReplacedError:
        return None


def test_a_process_is_replaced_by_one_with_the_same_command_line(commands: list[list[str]]) -> None:
    assert restart_at(1000.0) is None
    assert commands == [sys.orig_argv]


def test_a_second_time_within_a_minute_ends_with_a_status_and_a_later_one_does_not(
    commands: list[list[str]], caplog: pytest.LogCaptureFixture
) -> None:
    assert [restart_at(now_s) for now_s in (1000.0, 1059.0, 1061.0, 1062.0)] == [None, RESTORED, None, RESTORED]
    assert len(commands) == 2
    assert "do all API servers answer from the same etcd?" in caplog.text


def test_a_time_that_cannot_be_read_counts_as_long_ago(commands: list[list[str]]) -> None:
    os.environ[STARTED_AGAIN] = "yesterday"
    assert restart_at(1000.0) is None
    assert len(commands) == 1


def test_the_new_process_has_the_same_id_and_knows_when_it_was_started_again() -> None:
    environment = {key: value for key, value in os.environ.items() if key != STARTED_AGAIN}
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    first, second = (line.split() for line in done.stdout.splitlines())
    assert (first[0], first[1], second[1]) == (second[0], "False", "True")
    assert done.returncode == RESTORED
