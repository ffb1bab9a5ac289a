"""Two texts line by line, with what was added and taken away."""

from difflib import SequenceMatcher
from typing import NamedTuple


class Line(NamedTuple):
    """A line; `mark` is `added`, `removed` or empty."""

    text: str
    mark: str = ""


def mark_lines(before: str, after: str) -> tuple[Line, ...]:
    """Returns the lines of `after`, and in their places those of `before` that it has no more."""
    old_lines, new_lines = before.splitlines(), after.splitlines()
    lines: list[Line] = []
    for operation, old_start, old_end, new_start, new_end in SequenceMatcher(
        None, old_lines, new_lines, autojunk=False
    ).get_opcodes():
        if operation == "equal":
            lines += [Line(text) for text in new_lines[new_start:new_end]]
            continue
        lines += [Line(text, "removed") for text in old_lines[old_start:old_end]]
        lines += [Line(text, "added") for text in new_lines[new_start:new_end]]
    return tuple(lines)


def count_changes(lines: tuple[Line, ...]) -> int:
    """Returns how many lines are added or removed."""
    return sum(bool(line.mark) for line in lines)
