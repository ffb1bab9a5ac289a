"""Writes the newest readings whenever it is time, through outages and refusals, without ever keeping a backlog."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final, Protocol

from robotapp_agent.report.changes import SHORTEST_S, Pace, urgency
from robotapp_agent.report.readings import Readings
from robotapp_agent.report.status import Status, status_of
from robotapp_client.api.backoff import Backoff
from robotapp_client.transport.errors import ApiError, ClientError, Forbidden, NotFound, Unauthorized

log = logging.getLogger(__name__)

OUTAGE_CAP_S: Final = 30.0
"""Longest pause while the API server does not answer; in large clusters one interval, so that not all return at once."""
REFUSAL_CAP_S: Final = 300.0
"""Longest pause after a no that only an administrator can change."""
REPEAT_S: Final = 600.0
"""How often one and the same trouble is logged."""


class Writer(Protocol):
    """`ApiWriter`."""

    @property
    def refused(self) -> str: ...
    async def write(self, status: Status) -> tuple[str, ...]: ...


class Reporter:
    """Call `wake` after every change of what `readings` returns. `asked` gets spec.probe after every write."""

    def __init__(
        self,
        writer: Writer,
        readings: Callable[[], Readings],
        *,
        pace: Pace,
        asked: Callable[[tuple[str, ...]], None],
        clock: Callable[[], float],
        uniform: Callable[[], float],
    ) -> None:
        self._writer = writer
        self._readings = readings
        self._pace = pace
        self._asked = asked
        self._clock = clock
        self._uniform = uniform
        self._news = asyncio.Event()
        self._written: Status | None = None
        self._retry_s: float | None = None
        """When to try again, while the last write failed."""
        self._backoff: Backoff | None = None
        self._trouble = Trouble(clock)
        self.writes = 0

    def __repr__(self) -> str:
        return f"<Reporter: {self.writes} writes, {self._trouble!r}>"

    def wake(self) -> None:
        """Look at the readings again."""
        self._news.set()

    async def run(self) -> None:
        """Write for ever."""
        while True:
            self._news.clear()
            status = status_of(self._readings())
            rest_s = self._due_s(status) - self._clock()
            if rest_s > 0:
                await self._pause(rest_s)
            else:
                await self._write(status)

    def _due_s(self, status: Status) -> float:
        return self._pace.due_s(urgency(self._written, status)) if self._retry_s is None else self._retry_s

    async def _pause(self, seconds: float) -> None:
        try:
            async with asyncio.timeout(seconds):
                await self._news.wait()
        except TimeoutError:
            return

    async def _write(self, status: Status) -> None:
        interval_s = float(status.interval_seconds or 0)
        self._pace.wrote(self._clock(), interval_s=interval_s)
        try:
            asked = await self._writer.write(status)
        except ClientError as error:
            wait_s = self._wait_s(error, interval_s)
            self._retry_s = self._clock() + wait_s
            self._trouble.say(explain(error), wait_s)
            return
        self.writes += 1
        self._written, self._retry_s, self._backoff = status, None, None
        self._trouble.over(self._writer.refused)
        self._asked(asked)

    def _wait_s(self, error: ClientError, interval_s: float) -> float:
        """Pauses grow up to their longest; another kind of trouble begins anew only after a success."""
        if self._backoff is None:
            slow = is_refusal(error)
            cap_s = REFUSAL_CAP_S if slow else max(OUTAGE_CAP_S, interval_s)
            self._backoff = Backoff(base_s=40.0 if slow else 2 * SHORTEST_S, cap_s=cap_s, uniform=self._uniform)
        retry_after_s = error.retry_after_s if isinstance(error, ApiError) else None
        return self._backoff.next_s(at_least_s=min(retry_after_s, REFUSAL_CAP_S) if retry_after_s is not None else None)


class Trouble:
    """Logs why nothing is written: each new reason once, the same one every ten minutes, and the end of it."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._since_s: float | None = None
        self._said: tuple[str, float] = ("", 0.0)
        self._refused = ""

    def __repr__(self) -> str:
        return "no trouble" if self._since_s is None else f"trouble: {self._said[0]}"

    def say(self, reason: str, wait_s: float) -> None:
        now_s = self._clock()
        if self._since_s is None:
            self._since_s = now_s
        text, said_s = self._said
        if reason != text or now_s - said_s >= REPEAT_S:
            self._said = (reason, now_s)
            log.warning("the telemetry is not written, next try in %.0f s: %s", wait_s, reason)

    def over(self, refused: str) -> None:
        """A write succeeded; `refused` is what the API server said of a part that was left out."""
        if self._since_s is not None:
            log.info("the telemetry is written again, after %.0f s", self._clock() - self._since_s)
        self._since_s, self._said = None, ("", 0.0)
        if refused and refused != self._refused:
            log.error("the API server refuses a part of the status, which is left out for ten minutes: %s", refused)
        self._refused = refused


def is_refusal(error: ClientError) -> bool:
    """Whether only an administrator can change the answer. An outage, a conflict or too many requests pass by themselves."""
    return isinstance(error, ApiError) and error.status < 500 and error.status not in (401, 409, 429)


def explain(error: ClientError) -> str:
    """What is wrong and what to do."""
    if isinstance(error, Forbidden):
        return (
            f"{error}. The agent's service account must be allowed to create nodetelemetries and to patch nodetelemetries/status, "
            "and only for the node it runs on: install the chart's RBAC and policies of the same version (agent.enabled=true)"
        )
    if isinstance(error, NotFound):
        return f"{error}. The API server does not serve nodetelemetries.robotics.io: install the CRDs of the chart"
    if isinstance(error, Unauthorized):
        return (
            f"{error}. The token of the service account is not accepted; it is read again from its file at the next try"
        )
    return str(error)
