"""Variables of compose files: `${NAME:-default}` in values, and the lines of `.env` files."""

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from robotapp_cli.lint.marks import VALUE_MARK

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LINE: Final = re.compile(r"\s*(?:export\s+)?([A-Za-z_][A-Za-z0-9_.-]*)\s*(?:([=:])[ \t]*(.*))?", re.DOTALL)
_DEEPEST: Final = 20
_ESCAPES: Final = {"n": "\n", "r": "\r", "t": "\t", '"': '"', "\\": "\\", "$": "$$"}


class InterpolationError(Exception):
    """One sentence about a variable: what is wrong and what to do."""


class Text(NamedTuple):
    """A value after interpolation, and the variables in it that have no value."""

    value: str
    unset: tuple[str, ...] = ()


def interpolate(text: str, variables: Mapping[str, str], *, depth: int = 0) -> Text:
    """Replaces the variables of a value as the compose specification says. Raises InterpolationError.

    >>> interpolate("${TAG:-humble}-$$x", {})
    Text(value='humble-$x', unset=())
    """
    if "$" not in text:
        return Text(text)
    if depth > _DEEPEST:
        raise InterpolationError(f"variables are nested deeper than {_DEEPEST} levels; write the value")
    pieces: list[str] = []
    unset: list[str] = []
    position = 0
    while position < len(text):
        dollar = text.find("$", position)
        if dollar < 0:
            pieces.append(text[position:])
            break
        pieces.append(text[position:dollar])
        piece, position = _replace_one(text, dollar, variables, depth)
        pieces.append(piece.value)
        unset += piece.unset
    return Text("".join(pieces), tuple(dict.fromkeys(unset)))


def _replace_one(text: str, dollar: int, variables: Mapping[str, str], depth: int) -> tuple[Text, int]:
    """Returns what stands in place of the variable at `dollar`, and where the text goes on."""
    character = text[dollar + 1 : dollar + 2]
    if character == "$":
        return Text("$"), dollar + 2
    if character == "{":
        end = _find_end(text, dollar + 2)
        return _replace_braces(text[dollar + 2 : end], variables, depth), end + 1
    name = _NAME.match(text, dollar + 1)
    if name is None:  # such as $(id -u), which a shell in the container replaces
        return Text("$"), dollar + 1
    return _look_up(name[0], variables), name.end()


def _find_end(text: str, start: int) -> int:
    """Returns the position of the brace that closes the one before `start`."""
    depth, position = 1, start
    while position < len(text):
        if text[position] == "{" and text[position - 1] == "$":
            depth += 1
        elif text[position] == "}":
            depth -= 1
            if not depth:
                return position
        position += 1
    raise InterpolationError(f"{text[start - 2 : start + 20]!r} has no closing brace; write }} behind the variable")


def _look_up(name: str, variables: Mapping[str, str]) -> Text:
    return Text(variables[name]) if name in variables else Text("", (name,))


def _replace_braces(inner: str, variables: Mapping[str, str], depth: int) -> Text:
    """Returns the value of `NAME`, `NAME:-default`, `NAME:?error`, `NAME:+other`, and of those without the colon.

    A required variable without a value marks the place: all such places of a file are then known after one import.
    """
    name = _NAME.match(inner)
    operator = re.match(r":?[-?+]", inner[name.end() :]) if name else None
    if name is None or (name.end() < len(inner) and operator is None):
        raise InterpolationError(
            f"${{{inner}}} is no variable; write ${{NAME}}, ${{NAME:-default}} or $$ for a dollar sign"
        )
    if operator is None:
        return _look_up(name[0], variables)
    argument = inner[name.end() + operator.end() :]
    value = variables.get(name[0])
    has_value = bool(value) if operator[0][0] == ":" else value is not None
    kind = operator[0][-1]
    if kind == "+":
        return interpolate(argument, variables, depth=depth + 1) if has_value else Text("")
    if has_value:
        return Text(value or "")
    if kind == "-":
        return interpolate(argument, variables, depth=depth + 1)
    return Text(VALUE_MARK, (name[0],))


class Assignment(NamedTuple):
    """One variable of an env file; `text` is None where the line has a name alone."""

    line: int
    name: str
    text: str | None
    unset: tuple[str, ...] = ()


def parse_env_file(text: str, variables: Mapping[str, str]) -> Iterator[Assignment]:
    """Yields the variables of an env file; those above a line may be used in it. Raises InterpolationError."""
    scope = dict(variables)
    lines = iter(enumerate(text.splitlines(), start=1))
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise InterpolationError(
                f"line {number} is no NAME=VALUE; write one variable a line, or # before a comment"
            )
        if match[2] is None:
            yield Assignment(number, match[1], scope.get(match[1]))
            continue
        value_text = match[3]
        while value_text[:1] in ("'", '"') and _find_quote(value_text) < 0:
            next_line = next(lines, None)
            if next_line is None:
                raise InterpolationError(f"the quotes of {match[1]} in line {number} are not closed; close them")
            value_text += "\n" + next_line[1]
        value = _read_value(value_text, scope)
        scope[match[1]] = value.value
        yield Assignment(number, match[1], value.value, value.unset)


def _find_quote(written: str) -> int:
    """Returns the position of the quote that closes the first one, -1 without one."""
    position = 1
    while position < len(written):
        if written[position] == written[0]:
            return position
        position += 2 if written[position] == "\\" and written[0] == '"' else 1
    return -1


def _read_value(written: str, scope: Mapping[str, str]) -> Text:
    quote = written[:1]
    if quote == "'":
        return Text(written[1 : _find_quote(written)])
    if quote == '"':
        inner = written[1 : _find_quote(written)]
        plain = re.sub(r"\\(.)", lambda match: _ESCAPES.get(match[1], match[0]), inner, flags=re.DOTALL)
        return interpolate(plain, scope)
    return interpolate(re.split(r"(?:^|\s+)#", written, maxsplit=1)[0].strip(), scope)
