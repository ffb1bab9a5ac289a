"""Keeps which commit landed last and which tests of the rest still wait in this round: `.ci/landing.json`.

`scripts/test --landed` renews it. A round ends when every module of the rest has run; then the next one begins.
"""

import json
import re
import subprocess
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suite.repository import REPOSITORY, has_history, list_names, run_git

FILE: Final = Path(".ci/landing.json")
LANDINGS_PER_ROUND: Final = 8
"""So many landings run everything once."""
TEST_ROOTS: Final = ("tests/live", "e2e/tests/live")


class LandingError(Exception):
    """The record of the last landing cannot be used; the text names the cure."""


@dataclass(frozen=True, slots=True)
class Landing:
    """`landed` is a commit, `waiting` holds names of groups that have not run in this round, in the order of their turns."""

    landed: str
    waiting: tuple[str, ...]


def read_landing(root: Path = REPOSITORY) -> Landing:
    """Returns the recorded landing."""
    try:
        content = json.loads((root / FILE).read_text())
        landing = Landing(landed=str(content["landed"]), waiting=tuple(map(str, content["waiting"])))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LandingError(
            f"{FILE} cannot be read ({error!r}): restore it with git, or write "
            '{"landed": "<commit>", "waiting": []} to begin a new round'
        ) from None
    if not re.fullmatch("[0-9a-f]{40}", landing.landed):
        raise LandingError(
            f'{FILE}: "landed" is {landing.landed!r}, but must be the 40 hexadecimal digits of a commit: '
            "write the output of git rev-parse main"
        )
    return landing


def record_landing(waiting: Iterable[str], root: Path = REPOSITORY) -> Landing:
    """Records that HEAD has landed and what still waits: the first commit of new work carries the change."""
    head = run_git("rev-parse", "HEAD", root=root).decode().strip()
    if head == read_landing(root).landed:
        raise LandingError(f"{head[:12]} is recorded already: its turn must not be counted twice")
    landing = Landing(head, tuple(waiting))
    (root / FILE).write_text(json.dumps({"landed": landing.landed, "waiting": landing.waiting}, indent=1) + "\n")
    return landing


def check_landed(landed: str, root: Path = REPOSITORY) -> None:
    """Raises LandingError unless the repository holds the landed commit and HEAD is it or comes after it."""
    cure = f"git fetch --unshallow, or write a commit of main into {FILE}"
    checks = (
        (("cat-file", "-e", f"{landed}^{{commit}}"), "is not in this repository"),
        (("merge-base", "--is-ancestor", landed, "HEAD"), "is no ancestor of HEAD"),
    )
    for arguments, problem in checks:
        try:
            run_git(*arguments, root=root)
        except (OSError, subprocess.CalledProcessError) as error:
            message = getattr(error, "stderr", b"").decode().strip() or str(error)
            raise LandingError(f"landed commit {landed} {problem}: {cure} ({message})") from None


def list_changed_files(landed: str, root: Path = REPOSITORY) -> list[str] | None:
    """Returns the files that differ between the landed commit and the working tree, those not yet added included.

    Without a git repository it is None: then nothing can be compared.
    """
    if not has_history(root):
        return None
    check_landed(landed, root)
    changed_names = list_names("diff", "-z", "--name-only", "--no-renames", landed, root=root)
    new_names = list_names("ls-files", "-z", "--others", "--exclude-standard", root=root)
    return sorted({*changed_names, *new_names})


def list_test_modules() -> list[str]:
    """Returns the modules of live tests, those of the tools included."""
    paths = (path for root in TEST_ROOTS for path in (REPOSITORY / root).rglob("test_*.py"))
    return sorted(path.relative_to(REPOSITORY).as_posix() for path in paths)
