"""One run of an application through one fault: what was measured, and the promise that it did not keep.

What tries an application raises BrokenPromiseError for a promise that is not kept; figures that were measured before it stay.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from campaigns.reference.running_app import BrokenPromiseError

Figures = dict[str, float]
STOPPED_S: Final = 1.5
"""Half a second after the last command, and what a busy machine adds."""
HEALS_S: Final = 30.0
TCP_HEALS: Final = 1.0
"""After an outage TCP tries again when as much time has passed once more, at the latest."""


@dataclass(slots=True)
class Trial:
    """One application under one scheduler. `broken` is the promise that it did not keep, "" when it kept all.

    `fault` is as tables have it. `misplaced` has what its RobotApp asks for and its nodes do not have.
    """

    app: str
    scheduler: str
    fault: str
    outage_s: float = 0.0
    nodes: dict[str, str] = field(default_factory=dict)
    """By component, before the fault."""
    figures: Figures = field(default_factory=dict)
    broken: str = ""
    misplaced: list[str] = field(default_factory=list)
    began_at: str = ""
    took_s: float = 0.0

    def demand(self, condition: object, promise: str) -> None:
        """Raises BrokenPromiseError with the promise unless the condition holds."""
        if not condition:
            raise BrokenPromiseError(promise)

    @contextmanager
    def noting(self) -> Iterator[None]:
        """Notes the first promise that is not kept, and lets the trial go on, for there is more to measure."""
        try:
            yield
        except BrokenPromiseError as problem:
            self.broken = self.broken or str(problem)

    def outlast(self, began_s: float) -> None:
        """Waits until the outage has lasted as long as it shall."""
        time.sleep(max(began_s + self.outage_s - time.time(), 0))

    @property
    def heals_within_s(self) -> float:
        """Returns the seconds that connections may take to work again after the outage."""
        return HEALS_S + TCP_HEALS * self.outage_s


@dataclass(frozen=True, slots=True)
class Outage:
    """Begin and end of an outage, in seconds of the epoch."""

    began_s: float
    ended_s: float
