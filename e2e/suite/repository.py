"""Reads this repository through git. An unpacked source archive has no history: there the files of the folder are taken."""

import os
import subprocess
from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[2]


def has_history(root: Path = REPOSITORY) -> bool:
    """Returns True where the folder is a git repository or worktree of its own.

    What git refuses to read, for example the repository of another user, has a history all the same: errors are not hidden.
    """
    return (root / ".git").exists()


def run_git(*arguments: str, root: Path = REPOSITORY, stdin: str = "") -> bytes:
    """Returns the output of a git command; raises CalledProcessError when it fails."""
    command = ["git", *arguments]
    return subprocess.run(command, cwd=root, input=stdin.encode(), capture_output=True, check=True).stdout


def list_names(*arguments: str, root: Path = REPOSITORY) -> list[str]:
    """Returns the names that a git command prints with `-z`."""
    return run_git(*arguments, root=root).decode().split("\0")[:-1]


def list_python_files(root: Path = REPOSITORY) -> list[str]:
    """Returns the paths of Python files that git has or would add; without git, all but those in hidden folders."""
    if has_history(root):
        names = list_names("ls-files", "-z", "--cached", "--others", "--exclude-standard", "*.py", root=root)
        return [name for name in sorted(set(names)) if (root / name).is_file()]
    paths = []
    for folder, subfolders, names in os.walk(root):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        paths += [Path(folder, name).relative_to(root).as_posix() for name in names if name.endswith(".py")]
    return sorted(paths)
