"""Durations and rates in C++ expressions."""

import re
from dataclasses import dataclass

_UNITS = {"h": 3600.0, "min": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_CHRONO = {
    "hours": 3600.0,
    "minutes": 60.0,
    "seconds": 1.0,
    "milliseconds": 1e-3,
    "microseconds": 1e-6,
    "nanoseconds": 1e-9,
}
_NUMBER = r"(\d[\d']{0,12}(?:\.\d{0,9})?(?:e-?\d{1,2})?)"
_SUFFIXED = re.compile(rf"^{_NUMBER}(h|min|s|ms|us|ns)$")
_CALLED = re.compile(r"^(?:\w+::)*(\w+)(?:<[^()]{0,80}>)?[({](.*)[)}]$", re.DOTALL)
_PLAIN = re.compile(rf"^{_NUMBER}[fF]?$")
_FRACTION = re.compile(rf"^{_NUMBER}[fF]?/(.+)$", re.DOTALL)
_MEMBER = re.compile(r"\bparam(?:s|eters|eter|_)?\w{0,10}(?:\.|->)([a-z_]\w*(?:\.[a-z_]\w*){0,4})")
_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True, slots=True)
class Span:
    """Seconds (literal), or the parameter or variable that gives them; `is_rate`: that is in Hz."""

    seconds: float = -1.0
    parameter: str = ""
    is_rate: bool = False


def duration(expression: str, variables: dict[str, str]) -> Span:
    """`50ms`, `std::chrono::milliseconds(50)`, `ros::Duration(0.1)`, `1.0 / rate_`, `period_`."""
    text = _bare(expression)
    return _duration(text, variables, depth=0)


def _duration(text: str, variables: dict[str, str], *, depth: int) -> Span:
    while text.startswith("(") and text.endswith(")"):
        text = text[1:-1]
    if match := _SUFFIXED.match(text):
        return Span(_number(match.group(1)) * _UNITS[match.group(2)])
    if match := _PLAIN.match(text):
        return Span(_number(match.group(1)))
    if match := _FRACTION.match(text):
        below = match.group(2).strip("()")
        if plain := _PLAIN.match(below):
            rate = _number(plain.group(1))
            return Span(_number(match.group(1)) / rate) if rate > 0 else Span()
        return Span(parameter=_named(below, variables), is_rate=True)
    if depth < 4 and (match := _CALLED.match(text)):
        inner = _duration(match.group(2), variables, depth=depth + 1)
        factor = _CHRONO.get(match.group(1), 1.0)
        seconds = inner.seconds * factor if inner.seconds >= 0 else -1.0
        return Span(seconds, inner.parameter, inner.is_rate)
    return Span(parameter=_named(text, variables))


def _bare(expression: str) -> str:
    return re.sub(r"\s+|\bstatic_cast<[\w:]+>|\bthis->|\(int\)", "", expression).removesuffix(".toSec()")


def rate(expression: str, variables: dict[str, str]) -> Span:
    """The argument of `Rate r(…)`: a number of Hz, a duration, or a variable in Hz."""
    text = _bare(expression)
    if match := _PLAIN.match(text):
        hertz = _number(match.group(1))
        return Span(1.0 / hertz) if hertz > 0 else Span()
    found = duration(text, variables)
    return Span(found.seconds, found.parameter, is_rate=found.seconds < 0)


def _number(text: str) -> float:
    return float(text.replace("'", ""))


def _named(expression: str, variables: dict[str, str]) -> str:
    """The parameter behind the first variable of an expression that holds a parameter; "" when there is none."""
    for word in _WORD.findall(expression):
        if word in variables:
            return variables[word]
    if member := _MEMBER.search(expression):
        return member.group(1)
    match = re.search(r'(?:get_parameter|param|declare_parameter)\w*(?:<[\w:]+>)?\("([^"]{1,100})"', expression)
    return match.group(1) if match else ""
