"""Nothing grows too long to be read at once: files of at most 600 lines, functions of at most 60, and folders of at
most 14 Python files.

A line counts whatever is on it. What is longer for a reason is listed below, with the reason; an entry that is no longer
needed is an error too. `python scripts/sizes.py` prints every finding and ends with 1 when there are any;
`python scripts/sizes.py --figures` prints the figures of the scheduler that docs/design/010 compares.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median

from suite.repository import list_python_files

MOST_FILE = 600
MOST_FUNCTION = 60
MOST_IN_FOLDER = 14
SMALL = 60
ROOT = Path(__file__).resolve().parent.parent

EXCEPTIONS: dict[str, str] = {}
"""`path` or `path:function` → why it may be longer."""


def sources() -> list[Path]:
    """Python files git knows or would add."""
    return [ROOT / name for name in list_python_files(ROOT)]


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


def full_folders(paths: Iterable[Path]) -> dict[str, int]:
    """Returns the number of Python files of each folder that has too many, by the folder's path."""
    files = Counter(path.relative_to(ROOT).parent.as_posix() for path in paths)
    return {folder: count for folder, count in files.items() if count > MOST_IN_FOLDER}


def figures() -> Iterator[str]:
    """Of the scheduler. A module is a file that is no `__init__.py` or `__main__.py`; nested and private classes count."""
    texts = {path: path.read_text() for path in sources() if path.is_relative_to(ROOT / "scheduler")}
    lines = {path: text.count("\n") for path, text in texts.items() if not path.name.startswith("__")}
    classes = (isinstance(node, ast.ClassDef) for text in texts.values() for node in ast.walk(ast.parse(text)))
    yield f"{len(lines)} modules, {sum(lines.values())} lines, {sum(classes)} classes"
    yield f"median module {median(lines.values()):g} lines, {sum(n < SMALL for n in lines.values())} below {SMALL}"
    for path, count in sorted(lines.items(), key=lambda found: found[1]):
        if count < SMALL:
            yield f"{count:4} {path.relative_to(ROOT)}"


def main() -> int:
    if sys.argv[1:] == ["--figures"]:
        print(*figures(), sep="\n")
        return 0
    full = full_folders(sources())
    for folder, count in full.items():
        print(
            f"{folder}: {count} Python files, at most {MOST_IN_FOLDER}: join what is one concept, or make a folder of its own"
        )
    found = {part: (lines, limit) for path in sources() for part, lines, limit in long_parts(path)}
    for part, (lines, limit) in found.items():
        if part not in EXCEPTIONS:
            print(
                f"{part}: {lines} lines, at most {limit}: split it, or list it in {Path(__file__).name} with a reason"
            )
    stale = [part for part in EXCEPTIONS if part not in found]
    for part in stale:
        print(f"{part}: is not too long any more, take it off the list in {Path(__file__).name}")
    return 1 if full or stale or found.keys() - EXCEPTIONS.keys() else 0


if __name__ == "__main__":
    sys.exit(main())
