"""What people write on command lines and in environment variables, refused with what is allowed."""

import math
from argparse import ArgumentTypeError
from typing import Final

from robotapp_api.values.naming import DNS_LABEL

_MAX_PORT: Final = 65535


def is_name(text: str) -> bool:
    """Whether any object can have this name: DNS labels joined by dots."""
    return all(DNS_LABEL.fullmatch(label) for label in text.split("."))


def not_a_name(text: str) -> str:
    """The sentence that refuses such a name."""
    return f"{text!r} is not a name; names consist of lower-case letters, digits, '-' and '.', for example teleop"


def name(text: str) -> str:
    """The name of an object, or "" for none."""
    if text and not is_name(text):
        raise ArgumentTypeError(not_a_name(text))
    return text


def names(text: str) -> tuple[str, ...]:
    """Names separated by commas; spaces around them do not count."""
    return tuple(name(part) for each in text.split(",") if (part := each.strip()))


def seconds(text: str) -> float:
    """A time above zero; a period that is not would be a loop without a pause."""
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not (math.isfinite(found) and found > 0):
        raise ArgumentTypeError(f"{text!r} is not a number of seconds above zero, for example 30 or 0.5")
    return found


def port(text: str) -> int:
    """A TCP port; 0 has the meaning the flag gives it."""
    if not (text.isascii() and text.isdecimal() and int(text) <= _MAX_PORT):
        raise ArgumentTypeError(f"{text!r} is not a port; ports are 0 to {_MAX_PORT}")
    return int(text)
