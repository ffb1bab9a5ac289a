"""Batches responses under load: the event loop lets them gather for some milliseconds and reads them in one go.

Who takes each answer as it comes shares the core with those who make them, switches to and fro, and finds its caches cold
each time: beside a busy API server an eighth of our CPU, and a third of the cache misses. As long as many pods are on their
way to their nodes it is the API server all wait for, and none is bound later for it. Where answers come faster than
they are taken there is no rest at all.
"""

import asyncio
import select
from collections.abc import Callable
from typing import Final

TOGETHER: Final = 48
"""So many answers are to gather: few enough that the API server always has others to work on."""
LEAST_S: Final = 0.0005
MOST_S: Final = 0.03
TURNS: Final = 4
"""What one turn of the event loop reads wakes who decides and writes in the next ones: only then there is nothing to do."""


def _rest(seconds: float) -> None:
    """A sleep by a duration: `time.sleep` sleeps until a time, which fails when somebody moves the clocks of the process."""
    select.select((), (), (), seconds)


class ResponseBatching:
    """`begin` when there may be load; from then on the event loop rests whenever it has nothing to do, until there is none.

    `taken` counts the answers since the start; the rests grow and shrink with how many came during the last one.
    """

    def __init__(
        self, busy: Callable[[], bool], taken: Callable[[], int], *, rest: Callable[[float], None] = _rest
    ) -> None:
        self._busy = busy
        self._taken = taken
        self._rest = rest
        self._begun = False
        self._seen = self._rested_at = 0
        self._empty_turns = 0
        self._rest_s = LEAST_S

    def __repr__(self) -> str:
        return f"<Gathering, {f'{self._rest_s * 1e3:.1f} ms at a time' if self._begun else 'idle'}>"

    def begin(self) -> None:
        """Never rests itself."""
        if not self._begun and self._busy():
            self._begun = True
            self._seen = self._rested_at = self._taken()
            self._empty_turns = 0
            asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        if not self._busy():
            self._begun = False
            return
        taken = self._taken()
        self._empty_turns = self._empty_turns + 1 if taken == self._seen else 0
        self._seen = taken
        if self._empty_turns == TURNS:
            self._gather()
        asyncio.get_running_loop().call_soon(self._turn)

    def _gather(self) -> None:
        arrived = max(TOGETHER // 2, self._seen - self._rested_at)  # at most twice as long as the last one
        self._rest_s = min(MOST_S, max(LEAST_S, self._rest_s * TOGETHER / arrived))
        self._rested_at = self._seen
        self._empty_turns = 0
        self._rest(self._rest_s)
