"""When nothing is granted any more: found by what came meanwhile and not by the clock alone, so that a slow machine only takes longer."""

from collections.abc import Callable
from typing import Final

STALL_S: Final = 60.0
STALL_WISHES: Final = 30
"""So many came since the last grant."""


class Stall:
    """`look` as often as you like; `clock` is monotonic seconds."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._grants = self._wishes = 0
        self._since_s = clock()

    def __repr__(self) -> str:
        return f"<Stall: {self._grants} grants>"

    def look(self, *, grants: int, wishes: int) -> str:
        """What to tell when nothing is granted any more, else an empty text."""
        if grants != self._grants:
            self._grants, self._wishes, self._since_s = grants, wishes, self._clock()
            return ""
        seconds, came = self._clock() - self._since_s, wishes - self._wishes
        if seconds < STALL_S or came < STALL_WISHES:
            return ""
        return f"after {grants} grants nothing was granted for {seconds:.0f} s, while {came} wishes came"
