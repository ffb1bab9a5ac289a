"""Records which commit landed last and which part of the rest is next: `.ci/landing.json`, renewed by `scripts/test --landed`."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[2]
FILE: Final = REPOSITORY / ".ci" / "landing.json"
PARTS: Final = 8
"""So many landings run everything once."""


@dataclass(frozen=True, slots=True)
class Landing:
    """`landed` is a commit, `next_part` the number of a part from 1 to PARTS."""

    landed: str
    next_part: int


def read_landing() -> Landing:
    """Returns the recorded landing."""
    content = json.loads(FILE.read_text())
    return Landing(landed=str(content["landed"]), next_part=(int(content["next_part"]) - 1) % PARTS + 1)


def record_landing() -> Landing:
    """Records that HEAD has landed and that its part has run: the first commit of new work carries the change."""
    landing = Landing(_run_git("rev-parse", "HEAD").strip(), read_landing().next_part % PARTS + 1)
    FILE.write_text(json.dumps({"landed": landing.landed, "next_part": landing.next_part}) + "\n")
    return landing


def list_changed_files(landed: str) -> list[str] | None:
    """Returns the files that differ between the landed commit and the working tree; None when the commit is not here."""
    try:
        return _run_git("diff", "--name-only", "--no-renames", landed).splitlines()
    except subprocess.CalledProcessError:
        return None


def list_test_modules() -> list[str]:
    """Returns the modules of live tests, those of the tools included, as git has them or would add them."""
    patterns = (":(glob)tests/live/**/test_*.py", ":(glob)e2e/tests/live/**/test_*.py")
    names = _run_git("ls-files", "--cached", "--others", "--exclude-standard", *patterns).splitlines()
    return sorted(name for name in set(names) if (REPOSITORY / name).is_file())


def _run_git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
