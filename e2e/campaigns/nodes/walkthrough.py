"""A page that readers follow step by step: the files they save, the commands they type, and what they see."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_STEP = re.compile(r"(?:Save this as `([^`]+)`:\n)?```(\w*)\n(.*?)```", re.DOTALL)


@dataclass(frozen=True, slots=True)
class File:
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """`shown`: the lines that the page prints below it."""

    line: str
    shown: tuple[str, ...] = ()


def blocks(page: str) -> list[str]:
    """What stands in fences, of whatever language."""
    return re.findall(r"```[^\n]*\n(.*?)```", page, re.DOTALL)


def steps(page: str) -> Iterator[File | Command]:
    """In the order of the page. A block `console` has commands after `$ `, a block without a language nothing but commands."""
    for name, language, text in _STEP.findall(page):
        if name:
            yield File(name, text)
        elif language == "console":
            for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                line, *shown = part.splitlines()
                yield Command(line, tuple(shown))
        elif not language:
            yield from map(Command, text.splitlines())


def not_seen(shown: Sequence[str], output: str) -> list[str]:
    """Lines of a page that no line of the output equals. Numbers (ages, domains) and widths do not count; `…` is any text."""
    actual = [_like(line) for line in output.splitlines()]
    return [line for line in shown if not any(_pattern(line).fullmatch(other) for other in actual)]


def _like(line: str) -> str:
    """A line without numbers and without the room they take. An age is a number with units: `1m2s` is like `4s`."""
    return re.sub(r"\s+", " ", re.sub(r"\d+(\.\d+)?", "N", re.sub(r"\b(\d+[dhms])+\b", "N", line))).strip()


def _pattern(line: str) -> re.Pattern[str]:
    return re.compile(".*".join(re.escape(part.strip()) for part in _like(line).split("…")).replace(r"\ ", r"\s*"))
