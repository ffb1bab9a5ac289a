"""Values of compose files that know their file, line and path, in the forms that the compose specification has."""

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from robotapp_cli.importing.files.interpolation import InterpolationError, interpolate
from robotapp_cli.importing.report import ComposeError
from robotapp_cli.lint.findings import Path
from robotapp_cli.lint.reading import Node, UnreadableError, read, text_of

_TRUE: Final = frozenset({"true", "yes", "on", "y", "1"})
_FALSE: Final = frozenset({"false", "no", "off", "n", "0"})
_TRUE_OR_FALSE: Final = frozenset({"true", "false"})
"""Booleans of YAML 1.2, which compose reads; `yes` and `off` are text there, and booleans to kubectl."""


@dataclass(slots=True)
class Part:
    """One value: a scalar, a mapping (`fields`) or a list (`items`)."""

    file: str
    line: int
    path: Path = ()
    scalar: str | int | float | bool | None = None
    fields: "dict[str, Part] | None" = None
    items: "list[Part] | None" = None
    unset: tuple[str, ...] = ()
    """Variables without a value that stand in the scalar."""

    @property
    def is_empty(self) -> bool:
        return self.scalar is None and not self.fields and not self.items

    def fail(self, message: str) -> ComposeError:
        """Returns the error to raise about this value."""
        if self.unset:
            message += f" ({self.unset[0]} has no value; give --env {self.unset[0]}=VALUE)"
        return ComposeError(message, file=self.file, line=self.line, path=self.path)

    def get(self, name: str) -> "Part | None":
        """Returns the field of a mapping, None where it is not written or has no value."""
        part = (self.fields or {}).get(name)
        return None if part is None or part.is_empty else part

    def as_fields(self) -> "dict[str, Part]":
        """Returns the fields of a mapping. Raises ComposeError for everything else."""
        if self.fields is None and not self.is_empty:
            raise self.fail("a mapping is needed here; write NAME: VALUE lines")
        return self.fields or {}

    def as_items(self) -> "list[Part]":
        """Returns the entries of a list; a single value is a list of one."""
        if self.fields:
            raise self.fail("a list is needed here; begin every entry with -")
        return self.items or [] if self.items is not None or self.scalar is None else [self]

    def as_text(self) -> str:
        """Returns a scalar as compose hands it to a container."""
        if self.fields is not None or self.items is not None:
            raise self.fail("text is needed here; write one value, in quotes where it holds : or #")
        if isinstance(self.scalar, bool):
            return "true" if self.scalar else "false"
        return "" if self.scalar is None else str(self.scalar)

    def as_bool(self) -> bool:
        """Returns true or false. Raises ComposeError for what is neither."""
        text = self.as_text().lower()
        if text not in _TRUE | _FALSE:
            raise self.fail(f"{text!r} is neither true nor false; write one of them")
        return text in _TRUE

    def as_int(self, *, least: int = 0, most: int = 2**31 - 1) -> int:
        """Returns a whole number within the bounds."""
        text = self.as_text()
        number = int(text) if text.lstrip("-").isascii() and text.lstrip("-").isdigit() and len(text) < 20 else None
        if number is None or not least <= number <= most:
            raise self.fail(f"{text[:40]!r} is no whole number from {least} to {most}; write such a number")
        return number

    def as_words(self) -> list[str]:
        """Returns a command: a list as it is, a string split as a shell does."""
        if self.items is not None:
            return [item.as_text() for item in self.items]
        try:
            return shlex.split(self.as_text())
        except ValueError as error:
            raise self.fail("the quotes of this command are not closed; close them, or write a list") from error

    def list_pairs(self) -> "Iterator[tuple[str, Part, bool]]":
        """Yields name and value of a mapping, or of a list of NAME=VALUE; false where the name stands alone."""
        if self.fields is not None:
            for name, part in self.fields.items():
                yield name, part, part.scalar is not None or not part.is_empty
            return
        for item in self.as_items():
            name, equals, value = item.as_text().partition("=")
            yield name.strip(), replace(item, scalar=value), bool(equals)


def read_parts(data: bytes, file: str, variables: Mapping[str, str]) -> Part:
    """Returns the one document of a compose file, with its variables replaced. Raises ComposeError."""
    try:
        documents = list(read(text_of(data)))
    except UnreadableError as error:
        raise ComposeError(error.message, file=file, line=error.place.line) from error
    for document in documents:
        for place, problem in document.problems:
            raise ComposeError(problem, file=file, line=place.line)
    if len(documents) != 1:
        count = "no document" if not documents else f"{len(documents)} documents"
        raise ComposeError(f"there is {count} here; write one compose file with services", file=file, line=1)
    return _convert(documents[0].root, file, documents[0].root.place.line, (), variables)


def _convert(node: Node, file: str, line: int, path: Path, variables: Mapping[str, str]) -> Part:
    if isinstance(node.value, dict):
        fields = {
            name: _convert(inner, file, node.keys[str(name)].line, (*path, str(name)), variables)
            for name, inner in node.inner.items()
        }
        return Part(file, line, path, fields={str(name): part for name, part in fields.items()})
    if isinstance(node.value, list):
        inners = [
            _convert(inner, file, inner.place.line, (*path, position), variables)
            for position, inner in node.inner.items()
        ]
        return Part(file, line, path, items=inners)
    if isinstance(node.value, bool) and node.text.lower() not in _TRUE_OR_FALSE:
        return Part(file, line, path, node.text)
    if not isinstance(node.value, str):
        return Part(file, line, path, node.value)
    try:
        text = interpolate(node.value, variables)
    except InterpolationError as error:
        raise ComposeError(str(error), file=file, line=node.place.line, path=path) from error
    return Part(file, line, path, text.value, unset=text.unset)


def rebase(part: Part, path: Path) -> Part:
    """Returns a copy of the value at another path, with everything in it."""
    fields = (
        None if part.fields is None else {name: rebase(inner, (*path, name)) for name, inner in part.fields.items()}
    )
    items = None if part.items is None else [rebase(inner, (*path, at)) for at, inner in enumerate(part.items)]
    return replace(part, path=path, fields=fields, items=items)
