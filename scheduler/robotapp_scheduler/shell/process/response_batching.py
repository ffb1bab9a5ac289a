"""Batches responses under load: the event loop lets them gather for some milliseconds and reads them in one go.

A process that reads every response at once shares its core with the API server, is switched to and fro, and finds its CPU caches
cold each time: beside a busy API server that costs an eighth of its CPU and causes a third of its cache misses. While many
binds are under way the API server is the bottleneck, so no pod is bound later. Where responses come faster than they are
read there is no pause.
"""

import asyncio
import select
from collections.abc import Callable
from typing import Final

TOGETHER: Final = 48
"""Responses per batch: few enough that the API server always has other requests to work on."""
LEAST_S: Final = 0.0005
MOST_S: Final = 0.03
TURNS: Final = 4
"""Empty turns of the event loop before a pause: a response is read in one turn, its pod is handled in the next ones."""


def _rest(seconds: float) -> None:
    """Sleep for a duration. `time.sleep` sleeps until a time, which fails when the clocks of the process are changed."""
    select.select((), (), (), seconds)


class ResponseBatching:
    """Call `begin` when there may be load: the event loop then pauses whenever it has nothing to do, until `busy` is False.

    `taken` counts the responses since the start; pauses grow and shrink with how many came during the last one.
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
            self._batch()
        asyncio.get_running_loop().call_soon(self._turn)

    def _batch(self) -> None:
        arrived = max(TOGETHER // 2, self._seen - self._rested_at)  # at most twice as long as the last one
        self._rest_s = min(MOST_S, max(LEAST_S, self._rest_s * TOGETHER / arrived))
        self._rested_at = self._seen
        self._empty_turns = 0
        self._rest(self._rest_s)
