"""Errors and exit codes: every message names a place, what is wrong and what is allowed."""

import re
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

# Control characters, halves of characters, other line ends, and what turns the direction of the text after it.
_CONTROL: Final = re.compile("[\\x00-\\x1f\\x7f-\\x9f\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff]")


class Exit(IntEnum):
    """Exit codes of `rigel-bridge`; 70-79 are free in Rigel's own list."""

    OK = 0
    DIFFERENT = 1
    """`diff` found something, or nobody said yes to a difference that `rollback` showed."""
    USAGE = 2
    UNREADABLE = 70
    SYNTAX = 71
    INVALID = 72
    UNSUPPORTED = 73
    CLUSTER = 74
    """No kubectl, no connection, or the cluster refused."""
    NOT_READY = 75
    MISSING = 76
    """No such app, or no such past spec."""
    STEP_FAILED = 77
    """A program of a sequence failed."""
    INTERRUPTED = 130


@dataclass(frozen=True, slots=True)
class Place:
    """Where in which file; line 0 means the file as a whole."""

    file: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


class BridgeError(Exception):
    """A problem of the input. `code` becomes the exit code.

    path: that of the node that it is about, "" for none. meant: the key that was probably meant by its own, "" for none.
    """

    def __init__(
        self, place: Place, message: str, *, code: Exit = Exit.INVALID, path: str = "", meant: str = ""
    ) -> None:
        super().__init__(f"{place}: {message}")
        self.place = place
        self.code = code
        self.path = path
        self.meant = meant


def control_character(text: str, *, allowed: str = "") -> str:
    """The first character of a text that a terminal would act on instead of printing it; empty when there is none."""
    return next((found for found in _CONTROL.findall(text) if found not in allowed), "")


def printable(text: str) -> str:
    """The text for a terminal: what it would act on is written as an escape. Keys and values of a file stand in messages."""
    return _CONTROL.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def nearest(word: str, known: list[str]) -> str:
    """` (did you mean X?)` or nothing."""
    found = closest(word, known)
    return f" (did you mean {found}?)" if found else ""


def closest(word: str, known: list[str]) -> str:
    """The known word that was probably meant, or nothing."""
    from difflib import get_close_matches

    return next(iter(get_close_matches(word, known, n=1, cutoff=0.6)), "")
