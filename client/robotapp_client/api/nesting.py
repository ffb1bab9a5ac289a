"""Decodes JSON that a user nested deeper than the decoder goes: any object with free-form fields, such as parameters for a driver."""

import re
from collections.abc import Callable
from typing import Any, Final, TypeVar

T = TypeVar("T")

MOST_NESTED: Final = 200
"""The decoder gives up at about a thousand levels, also in parts it skips."""

_NESTING = re.compile(rb'"(?:[^"\\]|\\.)*+"|[{}\[\]]')


def decode_nested(decode: Callable[[Any], T], body: bytes) -> T:
    """Decodes the body, without what is nested too deep for the decoder. Raises what `decode` raises for other bodies."""
    try:
        return decode(body)
    except RecursionError:
        return decode(shallow(body))


def shallow(body: bytes, *, most: int = MOST_NESTED) -> bytes:
    """The same JSON with null for whatever is nested deeper: one such object would stop list and watch for ever.

    >>> shallow(b'{"a": [[{"b": "}"}], 1]}', most=2)
    b'{"a": [null, 1]}'
    """
    parts: list[bytes] = []
    depth = copied_to = 0
    for token in _NESTING.finditer(body):
        sign = body[token.start()]
        if sign in b"{[":
            if depth == most:
                parts += (body[copied_to : token.start()], b"null")
            depth += 1
        elif sign in b"}]":
            depth -= 1
            if depth == most:
                copied_to = token.end()
    return b"".join([*parts, body[copied_to:]])
