"""Operator versions, compared as numbers."""

import re
from typing import Final

_NUMBERS: Final = re.compile(r"\d+")


def is_newer(one: str, other: str) -> bool:
    """Is version `one` newer than `other`? An empty or unreadable version is older than every other."""
    return version_key(one) > version_key(other)


def version_key(version: str) -> tuple[tuple[int, ...], bool]:
    """Release numbers, then whether it is a release rather than a pre-release of it."""
    release, _, rest = version.partition("-")
    return tuple(int(number) for number in _NUMBERS.findall(release)), not rest
