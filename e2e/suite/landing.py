"""Keeps which commit landed last and which tests of the rest still wait in this round: `.ci/landing.json`.

`scripts/test --landed` renews it. A round ends when every module of the rest has run; then the next one begins.
"""

import json
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[2]
FILE: Final = REPOSITORY / ".ci" / "landing.json"
PARTS: Final = 8
"""So many landings run everything once."""
TEST_ROOTS: Final = ("tests/live", "e2e/tests/live")


class LandingError(Exception):
    """The record of the last landing cannot be used; the text names the cure."""


@dataclass(frozen=True, slots=True)
class Landing:
    """`landed` is a commit, `waiting` holds names of groups that have not run in this round, in the order of their turns."""

    landed: str
    waiting: tuple[str, ...]


def read_landing() -> Landing:
    """Returns the recorded landing."""
    try:
        content = json.loads(FILE.read_text())
        return Landing(landed=str(content["landed"]), waiting=tuple(map(str, content["waiting"])))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LandingError(
            f"{FILE.relative_to(REPOSITORY)} cannot be read ({error!r}): restore it with git, or write "
            '{"landed": "<commit>", "waiting": []} to begin a new round'
        ) from None


def record_landing(waiting: Iterable[str]) -> Landing:
    """Records that HEAD has landed and what still waits: the first commit of new work carries the change."""
    head = _run_git("rev-parse", "HEAD").strip()
    if head == read_landing().landed:
        raise LandingError(f"{head[:12]} is recorded already: its part must not be counted twice")
    landing = Landing(head, tuple(waiting))
    FILE.write_text(json.dumps({"landed": landing.landed, "waiting": landing.waiting}, indent=1) + "\n")
    return landing


def list_changed_files(landed: str) -> list[str] | None:
    """Returns the files that differ between the landed commit and the working tree; None when git cannot compare them."""
    try:
        return _run_git("diff", "--name-only", "--no-renames", landed).splitlines()
    except (OSError, subprocess.CalledProcessError):
        return None


def list_test_modules() -> list[str]:
    """Returns the modules of live tests, those of the tools included."""
    paths = (path for root in TEST_ROOTS for path in (REPOSITORY / root).rglob("test_*.py"))
    return sorted(path.relative_to(REPOSITORY).as_posix() for path in paths)


def _run_git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
