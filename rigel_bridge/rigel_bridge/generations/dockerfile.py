"""What Docker makes of the texts that Rigel writes into a Dockerfile, one `ENV NAME VALUE` or `CMD COMMAND` each. Pure.

Quotes, backslashes and `$NAME` follow BuildKit's own word rules (moby/buildkit `frontend/dockerfile/shell/lex.go`, the old form
of ENV with a blank between name and value). Kubernetes has other rules for the same fields, so its `$(NAME)` is escaped.
"""

import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

_CONTINUED: Final = re.compile(r"\\[ \t]*\n")
_REFERENCE: Final = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}|([A-Za-z_][A-Za-z0-9_]*)")
_ESCAPED_IN_QUOTES: Final = '"$\\'
_OPERATORS: Final = re.compile(r"\$\((?:ROBOTAPP|ROS)_[A-Z0-9_]*\)")
"""References that Kubernetes resolves: the operator writes these variables."""
_EXPANDED: Final = re.compile(rf"\$(?=\$|\()(?!{_OPERATORS.pattern[2:]})")
"""Any other `$` that Kubernetes would replace."""
_QUOTED: Final = re.compile(r"'[^']*'|\\.", re.DOTALL)
_IN_QUOTES: Final = re.compile(r'"[^"]*"')
_SHELL: Final = re.compile(r"[;&|<>()`*?~\[\]{}\n]|(?:^|\s)#|^\s*\w+=")
_BUILTINS: Final = (".", "cd", "eval", "exec", "export", "set", "source", "ulimit", "umask", "unset")


class DockerError(ValueError):
    """A text that `docker build` refuses."""


class FromBase(Exception):  # noqa: N818 - an outcome, no fault
    """The value depends on a variable that only the base image states, or on a form that is not worked out here."""


@dataclass(frozen=True, slots=True)
class ImageEnvironment:
    """Variables of an image. `from_base` maps the others to the part of their text that only a build works out."""

    values: Mapping[str, str] = field(default_factory=dict)
    from_base: Mapping[str, str] = field(default_factory=dict)


def read_env(texts: Mapping[str, str]) -> ImageEnvironment:
    """Works out the variables in their order: each may refer to those before it. DockerError names the variable."""
    values: dict[str, str] = {}
    from_base: dict[str, str] = {}
    for name, text in texts.items():
        try:
            values[name] = expand_word(text, values)
        except FromBase as reference:
            from_base[name] = str(reference)
            values.pop(name, None)
        except DockerError as error:
            raise DockerError(f"env {name}: {error}") from None
    return ImageEnvironment({name: values[name] for name in texts if name in values}, from_base)


def expand_word(text: str, variables: Mapping[str, str]) -> str:
    """Returns a value without its quotes and with its variables; FromBase where one is none of `variables`."""
    text = _CONTINUED.sub("", text).strip()
    if "\n" in text:
        raise DockerError("a value of several lines is no ENV of a Dockerfile; write it in one line")
    parts: list[str] = []
    position = 0
    quote = ""
    while position < len(text):
        character = text[position]
        position += 1
        if quote == "'":
            quote = "" if character == "'" else quote
            parts += [] if character == "'" else [character]
        elif character == quote:
            quote = ""
        elif character in "'\"" and not quote:
            quote = character
        elif character == "\\":
            following = text[position : position + 1]
            kept = "\\" if quote and following and following not in _ESCAPED_IN_QUOTES else ""
            parts += [kept, following]
            position += 1
        elif character == "$":
            value, position = _expand_reference(text, position, variables)
            parts.append(value)
        else:
            parts.append(character)
    if quote:
        raise DockerError(f"the quote {quote} is not closed")
    return "".join(parts)


def _expand_reference(text: str, position: int, variables: Mapping[str, str]) -> tuple[str, int]:
    """Returns what stands for the reference behind a `$`, and where the text goes on."""
    match = _REFERENCE.match(text, position)
    if match is None:
        if text[position : position + 1] == "{":
            raise FromBase(f"${text[position:].partition('}')[0]}}}")
        return "$", position
    name = match[1] or match[2]
    if name not in variables:
        raise FromBase(f"${match[0]}")
    return variables[name], match.end()


def escape_for_kubernetes(text: str) -> str:
    """Returns a text that Kubernetes, which replaces `$(NAME)` and `$$`, leaves as it is."""
    return _EXPANDED.sub("$$", text)


def read_command(text: str) -> list[str]:
    """Returns the words that a container gets from a CMD: a list in JSON, else a command line of a shell.

    A plain command line is split here, because a shell between would not pass signals on. ValueError for open quotes.
    """
    try:
        words = json.loads(text)
    except (ValueError, RecursionError):
        words = None
    if isinstance(words, list) and words and all(isinstance(word, str) for word in words):
        return words
    words = shlex.split(text)
    return ["/bin/sh", "-c", text.strip()] if _needs_shell(text, words) else words


def _needs_shell(text: str, words: list[str]) -> bool:
    without_single = _QUOTED.sub("", _OPERATORS.sub("", text))
    bare = _IN_QUOTES.sub("", without_single)
    expands = any(mark in without_single for mark in "$`")
    return expands or bool(_SHELL.search(bare)) or bool(words and words[0] in _BUILTINS)
