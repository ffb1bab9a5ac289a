"""The bytes a text takes in a status, and texts cut to a number of bytes."""

import json
import re
from collections.abc import Iterable
from typing import Any, Final

ELLIPSIS: Final = "…"
_LONGER: Final = {"<": 5, ">": 5, "&": 5, "\u2028": 3, "\u2029": 3}
"""Characters the API server stores as \\uXXXX, and by how much that is longer."""

_AS_IT_IS: Final = re.compile(r"[ !#-%'-;=?-\[\]-~]*")
"""A fast path: printable ASCII without what JSON or the API server escapes, so that each character is one byte."""


def stored_bytes(value: Any) -> int:
    """Bytes of a JSON value as the API server stores it."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return len(text.encode(errors="replace")) + sum(text.count(char) * more for char, more in _LONGER.items())


def clip(text: str, limit: int) -> str:
    """`text` in at most `limit` bytes as stored; … stands for what was cut off."""
    if _bytes(text) <= limit:
        return text
    left = limit - _bytes(ELLIPSIS)
    for index, char in enumerate(text):
        left -= _bytes(char)
        if left < 0:
            return text[:index] + ELLIPSIS
    return text


def _bytes(text: str) -> int:
    return len(text) if _AS_IT_IS.fullmatch(text) else stored_bytes(text) - len('""')


def shown(values: Iterable[object], limit: int = 8) -> str:
    """The first values and how many more there are: `a, b and 3 more`."""
    listed = [str(value) for value in values]
    more = f" and {len(listed) - limit} more" if len(listed) > limit else ""
    return (", ".join(listed[:limit]) or "none") + more


def count_of(part: int, total: int, noun: str, one: str = "is", more: str = "are") -> str:
    """Returns `1 of 3 edges is`, `2 of 3 edges are` or `1 of 1 edge is`. one, more: the verb."""
    return f"{part} of {total} {noun}{'' if total == 1 else 's'} {one if 1 in {part, total} else more}"


def count(number: int, noun: str, one: str = "is", more: str = "are") -> str:
    """Returns `1 edge is` or `2 edges are`. one, more: the verb."""
    return f"{number} {noun} {one}" if number == 1 else f"{number} {noun}s {more}"
