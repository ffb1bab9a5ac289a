"""What the operator remembers between runs of one app. All of it may be lost at any time: it only saves work or words."""

import dataclasses
from collections import defaultdict
from typing import Any

from robotapp_api.claims.domain import DomainOutcome
from robotapp_api.model.names import Reason

Trouble = tuple[Reason, str]


@dataclasses.dataclass(slots=True)
class AppMemory:
    """Per instance key: why it has no domain, what the server refused, which templates wait for approval."""

    outcomes: dict[str, DomainOutcome] = dataclasses.field(default_factory=dict)
    troubles: dict[str, Trouble] = dataclasses.field(default_factory=dict)
    held: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    settled: dict[str, tuple[int, str]] = dataclasses.field(default_factory=dict)
    new_domains: dict[str, int] = dataclasses.field(default_factory=dict)
    latency_written_s: float = float("-inf")
    bug: str = ""


class Memory:
    """By app uid."""

    def __init__(self) -> None:
        self._apps: defaultdict[str, AppMemory] = defaultdict(AppMemory)

    def __len__(self) -> int:
        return len(self._apps)

    def of(self, uid: str) -> AppMemory:
        """The app's memory, begun if there is none."""
        return self._apps[uid]

    def outcome(self, uid: str, robot: str) -> DomainOutcome | None:
        memory = self._apps.get(uid)
        return memory.outcomes.get(robot) if memory else None

    def waiting(self) -> list[tuple[str, str]]:
        """(uid, instance) of everything that has asked for a domain in vain."""
        return [
            (uid, robot)
            for uid, memory in self._apps.items()
            for robot, outcome in memory.outcomes.items()
            if outcome.id is None
        ]

    def forget(self, uid: str) -> None:
        self._apps.pop(uid, None)

    def forget_instances(self, uid: str, kept: set[str]) -> None:
        """Drop what is about instances the app no longer has."""
        memory = self._apps.get(uid)
        if memory is None:
            return
        tables: tuple[dict[str, Any], ...] = (memory.outcomes, memory.troubles, memory.held, memory.new_domains)
        for table in tables:
            for robot in set(table) - kept:
                del table[robot]
