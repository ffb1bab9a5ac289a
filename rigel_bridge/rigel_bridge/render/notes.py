"""What the user should be told about a rendering: a sentence can be true of a RobotApp and untrue of plain objects."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Note:
    """One note with its place in the file.

    `text` is true of a RobotApp. `plain` is what is true of plain objects (`--format pods` and `manifests`): None for the same
    text, empty for nothing.
    """

    text: str
    plain: str | None = None


def of_app(notes: Iterable[Note]) -> tuple[str, ...]:
    """The notes for a RobotApp, each once."""
    return tuple(dict.fromkeys(note.text for note in notes))


def of_plain(notes: Iterable[Note]) -> tuple[str, ...]:
    """The notes for plain objects, each once."""
    texts = (note.text if note.plain is None else note.plain for note in notes)
    return tuple(dict.fromkeys(text for text in texts if text))
