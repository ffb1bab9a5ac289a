"""What the bridge tells its user: a place, what is wrong and what is allowed."""

from dataclasses import dataclass
from enum import IntEnum


class Exit(IntEnum):
    """Exit codes of `rigel-bridge`; 70-79 are free in Rigel's own list."""

    OK = 0
    USAGE = 2
    UNREADABLE = 70
    SYNTAX = 71
    INVALID = 72
    UNSUPPORTED = 73


@dataclass(frozen=True, slots=True)
class Place:
    """Where in which file; line 0 means the file as a whole."""

    file: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


class BridgeError(Exception):
    """A problem of the input. `code` becomes the exit code."""

    def __init__(self, place: Place, message: str, *, code: Exit = Exit.INVALID) -> None:
        super().__init__(f"{place}: {message}")
        self.place = place
        self.code = code


def nearest(word: str, known: list[str]) -> str:
    """` (did you mean X?)` or nothing."""
    from difflib import get_close_matches

    found = get_close_matches(word, known, n=1, cutoff=0.6)
    return f" (did you mean {found[0]}?)" if found else ""
