"""Texts of launch files with `$(var x)`, `$(find pkg)`, `$(env X default)`, and the conditions made of them."""

import re
from collections.abc import Mapping
from typing import Final

from ros_profile.model.launch import NOT, UNKNOWN_TEXT

MAX_TEXT: Final = 2000
MAX_ROUNDS: Final = 20
_INNERMOST: Final = re.compile(r"\$\(([^()$]*)\)")
_FIND: Final = re.compile(r"\$\(find(?:-pkg-share|-pkg-prefix)? ([\w-]+) *\)/?(.*)")
_DIRNAME: Final = re.compile(r"\$\(dirname\)/?(.*)")
_TRUE: Final = frozenset({"true", "1", "1.0", "yes", "on"})
_FALSE: Final = frozenset({"false", "0", "0.0", "no", "off"})
_SIGNS: Final = frozenset("\"'=!<>")
"""What stands in no text that is compared."""
_MARK: Final = "\x01"


def resolve(text: str, values: Mapping[str, str], *, anonymous: str = "anonymous") -> str:
    """The text with every substitution that can be told; what cannot is `$(?)`. `$(find pkg)` stays for paths."""
    if "$(" not in text:
        return text
    for _ in range(MAX_ROUNDS):
        replaced = _INNERMOST.sub(lambda match: _one(match[1].lstrip(), values, anonymous), text[:MAX_TEXT])
        if replaced == text:
            break
        text = replaced
    return text.replace(_MARK, "$(")


def _one(body: str, values: Mapping[str, str], anonymous: str) -> str:
    verb, _, rest = body.partition(" ")
    if verb in ("var", "arg"):  # `$(var name )` has an empty default
        name, has_default, default = rest.lstrip().partition(" ")
        return values.get(name.strip("'\""), default if has_default else f"{_MARK}?)")
    if verb in ("env", "optenv"):
        return _environment(rest.lstrip(), is_optional=verb == "optenv")
    rest = rest.strip().strip("'\"")
    if verb in ("find", "find-pkg-share", "find-pkg-prefix"):
        return f"{_MARK}find {rest})"
    if verb == "anon":
        return f"{rest}_{anonymous}"
    if verb == "dirname":
        return f"{_MARK}dirname)"
    if verb == "if":
        parts = [part.strip() for part in body.partition(" ")[2].split("|")]
        return (parts[2] if truth(parts[0]) is False else parts[1]) if len(parts) == 3 else f"{_MARK}?)"
    if verb in ("eval", "not", "and", "or", "equals", "notequals"):
        verdict = _verdict(verb, body.partition(" ")[2].strip())
        return f"{_MARK}?)" if verdict is None else str(verdict).lower()
    return f"{_MARK}?)"


def _environment(rest: str, *, is_optional: bool) -> str:
    """Returns the default of `X default`, which may be empty (`X `, `X ''`); a variable is not set where this runs."""
    name, has_default, default = rest.partition(" ")
    return default.strip().strip("'\"") if has_default or is_optional or not name else f"{_MARK}?)"


def _verdict(verb: str, rest: str) -> bool | None:
    if verb == "eval":
        return truth(rest.strip("'\"") if rest[:1] == rest[-1:] and rest[:1] in "'\"" and "==" not in rest else rest)
    parts = [part.strip().strip("'\"") for part in rest.split("|")] if "|" in rest else [rest.strip("'\"")]
    if verb in ("equals", "notequals"):
        if len(parts) != 2 or any(UNKNOWN_TEXT in p or _MARK in p for p in parts):
            return None
        return (parts[0] == parts[1]) == (verb == "equals")
    verdicts = [truth(part) for part in parts]
    if verb == "not":
        return None if verdicts[0] is None else not verdicts[0]
    decisive = verb == "or"
    if decisive in verdicts:
        return decisive
    return None if None in verdicts else not decisive


def truth(text: str) -> bool | None:
    """What a condition's text means; None when it cannot be told. Comparisons of two texts, `and`, `or`, `not`."""
    text = text.strip()
    if UNKNOWN_TEXT in text or _MARK in text or len(text) > MAX_TEXT:
        return None
    low = text.strip("'\" ").lower()
    if low in _TRUE:
        return True
    if low in _FALSE or not low:
        return False
    for word, decisive in ((" or ", True), (" and ", False)):
        if word in text:
            verdicts = [truth(part) for part in text.split(word)]
            return decisive if decisive in verdicts else None if None in verdicts else not decisive
    if text.startswith("not "):
        inner = truth(text[4:])
        return None if inner is None else not inner
    return _compared(text)


def _compared(text: str) -> bool | None:
    """Of a comparison of two texts, in brackets or not; None for anything else."""
    operator = "==" if "==" in text else "!="
    one, found, other = text.partition(operator)
    left, right = _operand(one.lstrip("(")), _operand(other.rstrip(")"))
    if not found or not _SIGNS.isdisjoint(left + right):
        return None
    same = (
        left == right
        or (left.lower() in _TRUE and right.lower() in _TRUE)
        or (left.lower() in _FALSE and right.lower() in _FALSE)
    )
    return same == (operator == "==")


def _operand(text: str) -> str:
    """Without blanks and one quote at each end."""
    return text.strip().removeprefix('"').removeprefix("'").removesuffix('"').removesuffix("'").strip()


def condition_value(condition: str, values: Mapping[str, str]) -> bool | None:
    """A condition as readers write it: a text that must be true, or `not TEXT`."""
    if condition.startswith(NOT):
        inner = truth(resolve(condition.removeprefix(NOT), values))
        return None if inner is None else not inner
    return truth(resolve(condition, values))


def located(target: str, package: str) -> tuple[str, str]:
    """(package, path within it) of `$(find pkg)/path`, `$(dirname)/path`, or a path in the same package; an absolute path is of none."""
    if match := _FIND.search(target):
        return match[1], match[2].removeprefix(f"share/{match[1]}/")
    if match := _DIRNAME.search(target):
        return package, match[1]
    if target.startswith("/"):
        return "", target
    return package, target.replace(UNKNOWN_TEXT, "").strip("/")
