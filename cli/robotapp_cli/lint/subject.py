"""What is checked: one object of a file."""

from dataclasses import dataclass, field
from typing import Any

from robotapp_cli.lint.cel_rules import with_defaults
from robotapp_cli.lint.definitions import Definition
from robotapp_cli.lint.findings import Finding, Path
from robotapp_cli.lint.reading import Node


@dataclass(slots=True)
class Subject:
    """One object, and what the checks before found out about it."""

    definition: Definition
    root: Node
    """The document the object stands in."""
    at: Path
    """Where in the document: () unless it is an item of a List."""
    written: dict[str, Any]
    stored: dict[str, Any] = field(init=False)
    """The object with its defaults and without status."""
    unsound: set[Path] = field(default_factory=set)
    """Values that are incomplete, too long or not of their type."""
    found: list[Finding] = field(default_factory=list)
    """Of the checks before."""

    def __post_init__(self) -> None:
        own = {key: value for key, value in self.written.items() if key != "status"}
        self.stored = with_defaults(self.definition.schema, own)

    @property
    def title(self) -> str:
        """Kind and name, such as RobotApp/teleop."""
        metadata = self.written.get("metadata")
        name = metadata.get("name") if isinstance(metadata, dict) else None
        return f"{self.definition.kind}/{name}" if isinstance(name, str) else self.definition.kind
