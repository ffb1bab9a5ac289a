"""The report of an import: what became of each thing in the compose file."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple, Protocol

from robotapp_cli.lint.findings import Path, shown


class Verdict(StrEnum):
    """The fate of one thing of the compose file."""

    TAKEN = "taken"
    CHANGED = "changed"
    """Taken, but it means or needs something else in a cluster."""
    LEFT_OUT = "left out"
    CHOOSE = "choose"
    """The place is marked in the output, and a person has to write the value."""


class Located(Protocol):
    """Anything that stands somewhere in a file."""

    file: str
    line: int
    path: Path


class Line(NamedTuple):
    """One thing of the compose file. `path` is written as `services.nav.ports[0]`."""

    file: str
    line: int
    path: str
    verdict: Verdict
    message: str


class ComposeError(Exception):
    """The import ends here: the place and one sentence with what is wrong and what to write instead."""

    def __init__(self, message: str, *, file: str, line: int, path: Path = ()) -> None:
        place = f"{shown(path)}: " if path else ""
        super().__init__(f"{file}:{line}: {place}{message}")
        self.file, self.line, self.message = file, line, message


@dataclass(slots=True)
class Report:
    """The lines of an import, in the order in which the importer meets the things."""

    lines: list[Line] = field(default_factory=list)

    def add(self, verdict: Verdict, part: Located, message: str) -> None:
        """Adds a line about the thing at `part`."""
        self.lines.append(Line(part.file, part.line, shown(part.path), verdict, message))

    def take(self, part: Located, message: str) -> None:
        """Adds a line about a thing that means the same in the output."""
        self.add(Verdict.TAKEN, part, message)

    def change(self, part: Located, message: str) -> None:
        """Adds a line about a thing that is not quite the same in the output."""
        self.add(Verdict.CHANGED, part, message)

    def omit(self, part: Located, message: str) -> None:
        """Adds a line about a thing that the output does not have."""
        self.add(Verdict.LEFT_OUT, part, message)

    def mark(self, part: Located, message: str) -> None:
        """Adds a line about a place that is marked in the output."""
        self.add(Verdict.CHOOSE, part, message)

    def replace(self, part: Located, verdict: Verdict, message: str) -> None:
        """Adds a line about the thing at `part` in place of those that it has."""
        path = shown(part.path)
        self.lines = [line for line in self.lines if (line.file, line.path) != (part.file, path)]
        self.add(verdict, part, message)

    def sort(self) -> list[Line]:
        """Returns the lines ordered by file and line; those of one line stay in their order."""
        return sorted(self.lines, key=lambda line: (line.file, line.line))
