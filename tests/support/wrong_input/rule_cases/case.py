"""What a case of a rule is."""

from dataclasses import dataclass
from typing import Any

Object = dict[str, Any]


@dataclass(frozen=True)
class RuleCase:
    """`says` is the end of the message a user reads. For rules about changes, `before` is the stored object.

    Objects with a status are about the status: the server takes that only through its own path, as a change.
    """

    name: str
    good: Object
    bad: Object
    says: str
    before: Object | None = None

    def __str__(self) -> str:
        return self.name
