"""Functions on strings. Patterns are RE2's, as in Go: no pattern takes more than linear time."""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

import re2

from robotapp_api.values.cel.errors import EvaluationError, no_overload
from robotapp_api.values.cel.evaluation import limit_size
from robotapp_api.values.cel.library.standard import to_string

_WHITESPACE: Final = " \t\n\v\f\r\x85\xa0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a\u2028\u2029\u202f\u205f\u3000"
_LOWER: Final = {code: code + 32 for code in range(ord("A"), ord("Z") + 1)}
_UPPER: Final = {code: code - 32 for code in range(ord("a"), ord("z") + 1)}
_VERB: Final = re.compile(r"%(?:(?P<percent>%)|(?:\.(?P<precision>[0-9]{1,3}))?(?P<verb>[sdfebxXo]))")


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise no_overload(value)
    return value


def _integer(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise no_overload(value)
    return value


def contains(text: Any, part: Any) -> bool:
    """Is the part anywhere in the text?"""
    return _text(part) in _text(text)


def starts_with(text: Any, part: Any) -> bool:
    """Does the text begin with the part?"""
    return _text(text).startswith(_text(part))


def ends_with(text: Any, part: Any) -> bool:
    """Does the text end with the part?"""
    return _text(text).endswith(_text(part))


# --- Patterns --------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=512)
def _pattern(text: str) -> Any:
    options = re2.Options()
    options.log_errors = False
    options.never_capture = True
    options.max_mem = 1 << 20
    try:
        return re2.compile(text, options)
    except re2.error as trouble:
        raise EvaluationError(f"Illegal regex: {trouble}") from None


def matches(text: Any, pattern: Any) -> bool:
    """Is the pattern found anywhere in the text?"""
    return _pattern(_text(pattern)).search(_text(text)) is not None


def find(text: Any, pattern: Any) -> str:
    """The first match, "" without."""
    match = _pattern(_text(pattern)).search(_text(text))
    return match.group(0) if match is not None else ""


def find_all(text: Any, pattern: Any, most: Any = -1) -> list[str]:
    """All matches, or the first few."""
    found = [match.group(0) for match in _pattern(_text(pattern)).finditer(_text(text))]
    return found if _integer(most) < 0 else found[:most]


# --- Parts -----------------------------------------------------------------------------------------------------------


def _position(index: Any, text: str) -> int:
    position = _integer(index)
    if not 0 <= position <= len(text):
        raise EvaluationError(f"index out of range: {position}")
    return position


def char_at(text: Any, index: Any) -> str:
    """The character at a position, "" behind the last."""
    position = _position(index, _text(text))
    return _text(text)[position : position + 1]


def index_of(text: Any, part: Any, start: Any = 0) -> int:
    """First position of the part, -1 without."""
    if not _text(part):
        return _integer(start)
    return _text(text).find(part, _position(start, text))


def last_index_of(text: Any, part: Any, start: Any = None) -> int:
    """Last position of the part, -1 without."""
    if start is None:
        return _text(text).rfind(_text(part))
    if not _text(part):
        return _integer(start)
    return _text(text).rfind(part, 0, _position(start, text) + len(part))


def substring(text: Any, start: Any, end: Any = None) -> str:
    """Characters from `start` up to `end`."""
    first = _position(start, _text(text))
    last = len(text) if end is None else _position(end, text)
    if first > last:
        raise EvaluationError(f"invalid substring range. start: {first}, end: {last}")
    return _text(text)[first:last]


def split(text: Any, separator: Any, most: Any = -1) -> list[str]:
    """Parts between separators; an empty separator splits into characters."""
    limit = _integer(most)
    if limit == 0:
        return []
    if _text(separator):
        return _text(text).split(separator, limit - 1 if limit > 0 else -1)
    characters = list(_text(text))
    if 0 < limit < len(characters):
        return [*characters[: limit - 1], "".join(characters[limit - 1 :])]
    return characters


def join(texts: Any, separator: Any = "") -> str:
    """All strings of a list in one."""
    if not isinstance(texts, list):
        raise no_overload(texts)
    limit_size(sum(len(_text(text)) for text in texts) + len(_text(separator)) * len(texts))
    return str(separator).join(texts)


def replace(text: Any, old: Any, new: Any, most: Any = -1) -> str:
    """The text with `new` for `old`, everywhere or a number of times."""
    limit_size(len(_text(text)) + (_text(text).count(_text(old))) * len(_text(new)))
    return str(text.replace(old, new, _integer(most)))


def lower_ascii(text: Any) -> str:
    """A-Z in lower case."""
    return _text(text).translate(_LOWER)


def upper_ascii(text: Any) -> str:
    """a-z in upper case."""
    return _text(text).translate(_UPPER)


def trim(text: Any) -> str:
    """The text without white space around it."""
    return _text(text).strip(_WHITESPACE)


def quote(text: Any) -> str:
    """The text as a constant of CEL."""
    escapes = {"\a": "\\a", "\b": "\\b", "\f": "\\f", "\n": "\\n", "\r": "\\r", "\t": "\\t", "\v": "\\v"}
    escapes |= {"\\": "\\\\", '"': '\\"'}
    return f'"{"".join(escapes.get(character, character) for character in _text(text))}"'


# --- Formats ---------------------------------------------------------------------------------------------------------


def format_text(template: Any, values: Any) -> str:
    """Fills the verbs of a template (%s, %d, %.2f) with the values of a list."""
    if not isinstance(values, list):
        raise no_overload(values)
    remaining = iter(values)

    def verb(match: re.Match[str]) -> str:
        if match["percent"]:
            return "%"
        try:
            value = next(remaining)
        except StopIteration:
            raise EvaluationError(f"index {len(values)} out of range") from None
        shown = _VERBS[match["verb"]](value, int(match["precision"] or 6))
        limit_size(len(shown))
        return shown

    return _VERB.sub(verb, _text(template))


def shown(value: Any, _precision: int = 0) -> str:
    """%s of any value."""
    if value is None:
        return "null"
    if isinstance(value, list):
        return f"[{', '.join(shown(item) for item in value)}]"
    if isinstance(value, dict):
        entries = sorted(f"{shown(key)}: {shown(item)}" for key, item in value.items())
        return "{" + ", ".join(entries) + "}"
    return to_string(value)


def _decimal(value: Any, _precision: int) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise no_overload(value)
    return to_string(value)


def _fixed(value: Any, precision: int) -> str:
    return f"{_number(value):.{precision}f}"


def _scientific(value: Any, precision: int) -> str:
    return f"{_number(value):.{precision}e}"


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise no_overload(value)
    return float(value)


def _binary(value: Any, _precision: int) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    return f"{_integer(value):b}"


def _octal(value: Any, _precision: int) -> str:
    return f"{_integer(value):o}"


def _hexadecimal(value: Any, _precision: int) -> str:
    if isinstance(value, str):
        return value.encode().hex()
    return value.hex() if isinstance(value, bytes) else f"{_integer(value):x}"


_VERBS: Final[dict[str, Callable[[Any, int], str]]] = {
    "s": shown,
    "d": _decimal,
    "f": _fixed,
    "e": _scientific,
    "b": _binary,
    "o": _octal,
    "x": _hexadecimal,
    "X": lambda value, precision: _hexadecimal(value, precision).upper(),
}
