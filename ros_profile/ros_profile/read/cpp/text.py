"""The text of a C++ file without comments, at unchanged places, and the string literals in it."""

import re
from bisect import bisect_right
from dataclasses import dataclass, field

from ros_profile.read.text import decode

LARGEST_CHARACTERS = 400 * 1024
"""What comes after is not read: sources this long are generated tables."""

_RAW = r'(?<![A-Za-z0-9_])R"(?P<mark>[^()\\\s]{0,16})\((?:.*?\)(?P=mark)"|.*\Z)'
_TOKENS = re.compile(
    rf"{_RAW}"
    r"|(?P<comment>//[^\n]*|/\*(?:.*?\*/|.*\Z))"
    r'|(?P<text>"(?:\\.|[^"\\\n])*"?)'
    r"|'(?:\\.|[^'\\\n]){1,4}'",
    re.DOTALL,
)
_NOT_NEWLINE = re.compile(r"[^\n]")


@dataclass(frozen=True, slots=True)
class Literal:
    """A string literal without its quotes; `start` is the place of the opening quote."""

    text: str
    start: int


@dataclass(slots=True)
class Source:
    """`code` has the length and the lines of the file, with comments blanked; string literals stand in it."""

    code: str
    literals: tuple[Literal, ...]
    line_starts: list[int] = field(default_factory=list)

    def line(self, place: int) -> int:
        return bisect_right(self.line_starts, place)


def source(data: bytes) -> Source:
    text = decode(data)[:LARGEST_CHARACTERS]
    pieces: list[str] = []
    literals: list[Literal] = []
    end = 0
    for match in _TOKENS.finditer(text):
        if match.lastgroup == "text":
            literals.append(Literal(match.group().strip('"'), match.start()))
        elif match.lastgroup == "comment":
            pieces.append(text[end : match.start()])
            pieces.append(_NOT_NEWLINE.sub(" ", match.group()))
            end = match.end()
    pieces.append(text[end:])
    code = "".join(pieces)
    starts = [0, *(found.end() for found in re.finditer(r"\n", code))]
    return Source(code, tuple(literals), starts)


LONGEST = 4000


_BRACKETS = {
    ")": re.compile(r'"(?:\\.|[^"\\\n])*"?|(?P<open>\()|(?P<close>\))'),
    "}": re.compile(r'"(?:\\.|[^"\\\n])*"?|(?P<open>\{)|(?P<close>\})'),
    ">": re.compile(r'"(?:\\.|[^"\\\n])*"?|->|(?P<open><)|(?P<close>>)|(?P<end>[;{}])'),
}


def balanced(code: str, start: int, *, close: str) -> int:
    """Place after the bracket that closes the one at `start`, or -1 within LONGEST characters. Skips string literals."""
    depth = 0
    for match in _BRACKETS[close].finditer(code, start, start + LONGEST):
        if match.lastgroup == "open":
            depth += 1
        elif match.lastgroup == "close":
            depth -= 1
            if depth == 0:
                return match.end()
        elif match.lastgroup == "end":
            return -1
    return -1


def _after_literal(code: str, place: int, end: int) -> int:
    place += 1
    while place < end and code[place] not in '"\n':
        place += 2 if code[place] == "\\" else 1
    return place + 1


def split_arguments(text: str) -> list[str]:
    """Arguments at the outermost level, stripped: `a, b(c, d), e<f, g>` has three."""
    found: list[str] = []
    depth, begin, place, end = 0, 0, 0, len(text)
    while place < end:
        char = text[place]
        if char == '"':
            place = _after_literal(text, place, end)
            continue
        if char in "([{" or (char == "<" and place and text[place - 1].isalnum()):
            depth += 1
        elif char in ")]}" or (char == ">" and depth and text[place - 1] != "-"):
            depth -= 1
        elif char == "," and depth <= 0:
            found.append(text[begin:place].strip())
            begin = place + 1
        place += 1
    last = text[begin:].strip()
    return [*found, last] if last or found else []


def literal_of(argument: str) -> str | None:
    """The text of an argument that is one string literal, also in `std::string("…")`."""
    match = re.fullmatch(r'(?:(?:std::)?string\s*[({]\s*)?"((?:\\.|[^"\\])*)"s?\s*[)}]?', argument)
    return match.group(1) if match else None
