"""Nothing grows too long to be read at once: files of at most 600 lines, functions of at most 60.

A line counts whatever is on it. What is longer for a reason is listed below, with the reason; an entry that is no longer
needed is an error too. `python scripts/sizes.py` prints every finding and ends with 1 when there are any.
"""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

MOST_FILE = 600
MOST_FUNCTION = 60
ROOT = Path(__file__).resolve().parent.parent

EXCEPTIONS: dict[str, str] = {}
"""`path` or `path:function` → why it may be longer."""


def sources() -> list[Path]:
    """Python files git knows or would add."""
    argv = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py"]
    listed = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [ROOT / name for name in sorted(set(listed)) if (ROOT / name).is_file()]


def long_parts(path: Path) -> Iterator[tuple[str, int, int]]:
    """(name, lines, limit) of the file and of each function that is too long."""
    name = path.relative_to(ROOT).as_posix()
    text = path.read_text()
    lines = text.count("\n")
    if lines > MOST_FILE:
        yield name, lines, MOST_FILE
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > MOST_FUNCTION:
                yield f"{name}:{node.name}", length, MOST_FUNCTION


def main() -> int:
    found = {part: (lines, limit) for path in sources() for part, lines, limit in long_parts(path)}
    for part, (lines, limit) in found.items():
        if part not in EXCEPTIONS:
            print(
                f"{part}: {lines} lines, at most {limit}: split it, or list it in {Path(__file__).name} with a reason"
            )
    stale = [part for part in EXCEPTIONS if part not in found]
    for part in stale:
        print(f"{part}: is not too long any more, take it off the list in {Path(__file__).name}")
    return 1 if stale or found.keys() - EXCEPTIONS.keys() else 0


if __name__ == "__main__":
    sys.exit(main())
