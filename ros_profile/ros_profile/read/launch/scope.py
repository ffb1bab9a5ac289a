"""What a group of a launch file gives to everything below it."""

from dataclasses import dataclass
from typing import Final

MAX_NODES: Final = 1000
"""Nodes that are read of one launch file, whatever its format; lists of a Python launch file are no longer either."""


@dataclass(slots=True)
class Scope:
    namespace: str = ""
    remaps: tuple[tuple[str, str], ...] = ()
    conditions: tuple[str, ...] = ()
    environment: tuple[tuple[str, str], ...] = ()

    def inner(self, *conditions: str) -> "Scope":
        """A scope of its own that begins as this one."""
        return Scope(self.namespace, self.remaps, (*self.conditions, *conditions), self.environment)


def join(outer: str, inner: str) -> str:
    """A namespace within another; one that begins with a slash stands for itself."""
    if not inner or inner.startswith("/"):
        return inner or outer
    return f"{outer.rstrip('/')}/{inner}" if outer else inner
