"""Functions on strings. Patterns are RE2's, as in Go: no pattern takes more than linear time."""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

import re2

from robotapp_api.values.cel.errors import EvaluationError, make_overload_error
from robotapp_api.values.cel.evaluation import limit_size
from robotapp_api.values.cel.library.standard import to_string
from robotapp_api.values.cel.values import TypeValue, get_type

_WHITESPACE: Final = " \t\n\v\f\r\x85\xa0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a\u2028\u2029\u202f\u205f\u3000"
_LOWER: Final = {code: code + 32 for code in range(ord("A"), ord("Z") + 1)}
_UPPER: Final = {code: code - 32 for code in range(ord("a"), ord("z") + 1)}
_VERB: Final = re.compile(r"%(?:(?P<percent>%)|(?:\.(?P<precision>[0-9]{1,3}))?(?P<verb>[sdfbxXo]))")


def _check_text(value: Any) -> str:
    if not isinstance(value, str):
        raise make_overload_error(value)
    return value


def _check_integer(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise make_overload_error(value)
    return value


def has_part(text: Any, part: Any) -> bool:
    """Returns whether the part is anywhere in the text."""
    return _check_text(part) in _check_text(text)


def starts_with(text: Any, part: Any) -> bool:
    """Returns whether the text begins with the part."""
    return _check_text(text).startswith(_check_text(part))


def ends_with(text: Any, part: Any) -> bool:
    """Returns whether the text ends with the part."""
    return _check_text(text).endswith(_check_text(part))


# --- Patterns --------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=512)
def _compile_pattern(text: str) -> Any:
    options = re2.Options()
    options.log_errors = False
    options.never_capture = True
    options.max_mem = 1 << 20
    try:
        return re2.compile(text, options)
    except re2.error as trouble:
        reason = trouble.args[0] if trouble.args else ""
        text = reason.decode(errors="replace") if isinstance(reason, bytes) else str(reason)
        raise EvaluationError(f"Illegal regex: {text}") from None


def matches(text: Any, pattern: Any) -> bool:
    """Returns whether the pattern matches any part of the text."""
    return _compile_pattern(_check_text(pattern)).search(_check_text(text)) is not None


def find(text: Any, pattern: Any) -> str:
    """The first match, "" without."""
    match = _compile_pattern(_check_text(pattern)).search(_check_text(text))
    return match.group(0) if match is not None else ""


def find_all(text: Any, pattern: Any, most: Any = -1) -> list[str]:
    """All matches, or the first few."""
    matching_parts = [match.group(0) for match in _compile_pattern(_check_text(pattern)).finditer(_check_text(text))]
    return matching_parts if _check_integer(most) < 0 else matching_parts[:most]


# --- Parts -----------------------------------------------------------------------------------------------------------


def _check_position(index: Any, text: str) -> int:
    position = _check_integer(index)
    if not 0 <= position <= len(text):
        raise EvaluationError(f"index out of range: {position}")
    return position


def get_character(text: Any, index: Any) -> str:
    """The character at a position, "" behind the last."""
    position = _check_position(index, _check_text(text))
    return _check_text(text)[position : position + 1]


def find_first(text: Any, part: Any, start: Any = 0) -> int:
    """First position of the part, -1 without."""
    if not _check_text(part):
        return _check_integer(start)
    return _check_text(text).find(part, _check_position(start, text))


def find_last(text: Any, part: Any, start: Any = None) -> int:
    """Last position of the part, -1 without."""
    if start is None:
        return _check_text(text).rfind(_check_text(part))
    if not _check_text(part):
        return _check_integer(start)
    return _check_text(text).rfind(part, 0, _check_position(start, text) + len(part))


def cut(text: Any, start: Any, end: Any = None) -> str:
    """Characters from `start` up to `end`."""
    first = _check_position(start, _check_text(text))
    last = len(text) if end is None else _check_position(end, text)
    if first > last:
        raise EvaluationError(f"invalid substring range. start: {first}, end: {last}")
    return _check_text(text)[first:last]


def split(text: Any, separator: Any, most: Any = -1) -> list[str]:
    """Parts between separators; an empty separator splits into characters."""
    limit = _check_integer(most)
    if limit == 0:
        return []
    if _check_text(separator):
        return _check_text(text).split(separator, limit - 1 if limit > 0 else -1)
    characters = list(_check_text(text))
    if 0 < limit < len(characters):
        return [*characters[: limit - 1], "".join(characters[limit - 1 :])]
    return characters


def join(texts: Any, separator: Any = "") -> str:
    """All strings of a list in one."""
    if not isinstance(texts, list):
        raise make_overload_error(texts)
    limit_size(sum(len(_check_text(text)) for text in texts) + len(_check_text(separator)) * len(texts))
    return str(separator).join(texts)


def replace(text: Any, old: Any, new: Any, most: Any = -1) -> str:
    """The text with `new` for `old`, everywhere or a number of times."""
    limit_size(len(_check_text(text)) + (_check_text(text).count(_check_text(old))) * len(_check_text(new)))
    return str(text.replace(old, new, _check_integer(most)))


def lower(text: Any) -> str:
    """Writes A-Z in lower case."""
    return _check_text(text).translate(_LOWER)


def raise_case(text: Any) -> str:
    """Writes a-z in upper case."""
    return _check_text(text).translate(_UPPER)


def trim(text: Any) -> str:
    """The text without white space around it."""
    return _check_text(text).strip(_WHITESPACE)


def quote(text: Any) -> str:
    """The text as a constant of CEL."""
    escapes = {"\a": "\\a", "\b": "\\b", "\f": "\\f", "\n": "\\n", "\r": "\\r", "\t": "\\t", "\v": "\\v"}
    escapes |= {"\\": "\\\\", '"': '\\"'}
    return f'"{"".join(escapes.get(character, character) for character in _check_text(text))}"'


# --- Formats ---------------------------------------------------------------------------------------------------------


def format_text(template: Any, values: Any) -> str:
    """Fills the verbs of a template (%s, %d, %.2f) with the values of a list."""
    if not isinstance(values, list):
        raise make_overload_error(values)
    value_iterator = iter(values)

    def write_value(match: re.Match[str]) -> str:
        if match["percent"]:
            return "%"
        try:
            value = next(value_iterator)
        except StopIteration:
            raise EvaluationError(f"index {len(values)} out of range") from None
        value_text = _VERBS[match["verb"]](value, int(match["precision"] or 6))
        limit_size(len(value_text))
        return value_text

    return _VERB.sub(write_value, _check_text(template))


def _write_general(value: Any, _precision: int) -> str:
    """Writes any value: strings as they are, but quoted within lists and maps."""
    return to_string(value) if isinstance(value, str | bytes | float) else _write_nested(value)


def _write_nested(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, str):
        return quote(value)
    if isinstance(value, bytes):
        return f"b{quote(to_string(value))}"
    if isinstance(value, float):
        return f"{value:.6f}"
    if isinstance(value, list):
        return f"[{', '.join(_write_nested(item) for item in value)}]"
    if isinstance(value, dict):
        return (
            "{" + ", ".join(sorted(f"{_write_nested(key)}:{_write_nested(item)}" for key, item in value.items())) + "}"
        )
    return value.type_name if isinstance(value, TypeValue) else to_string(value)


def _write_decimal(value: Any, _precision: int) -> str:
    if isinstance(value, bool) or not isinstance(value, int):
        kind = get_type(value).type_name
        raise EvaluationError(f"error during formatting: decimal clause can only be used on integers, was given {kind}")
    return to_string(value)


def _write_fixed(value: Any, precision: int) -> str:
    return f"{_check_number(value):.{precision}f}"


def _check_number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise make_overload_error(value)
    return float(value)


def _write_binary(value: Any, _precision: int) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    return f"{_check_integer(value):b}"


def _write_octal(value: Any, _precision: int) -> str:
    return f"{_check_integer(value):o}"


def _write_hexadecimal(value: Any, _precision: int) -> str:
    if isinstance(value, str):
        return value.encode().hex()
    return value.hex() if isinstance(value, bytes) else f"{_check_integer(value):x}"


_VERBS: Final[dict[str, Callable[[Any, int], str]]] = {
    "s": _write_general,
    "d": _write_decimal,
    "f": _write_fixed,
    "b": _write_binary,
    "o": _write_octal,
    "x": _write_hexadecimal,
    "X": lambda value, precision: _write_hexadecimal(value, precision).upper(),
}
