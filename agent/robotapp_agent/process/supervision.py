"""Keeps the parts of the agent running: an error ends one part for a moment, never the others."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Final

from robotapp_client.api.backoff import Backoff

log = logging.getLogger(__name__)

REPEAT_S: Final = 600.0
"""How often the same error of a part is logged."""
STABLE_S: Final = 60.0
"""A part that ran this long starts again without delay."""
LONGEST_S: Final = 60.0


async def supervised(
    name: str,
    run: Callable[[], Awaitable[None]],
    *,
    clock: Callable[[], float],
    backoff: Backoff | None = None,
) -> None:
    """Run a part for ever. What it raises is logged with its stack, the same error again only every ten minutes."""
    backoff = backoff or Backoff(base_s=1.0, cap_s=LONGEST_S)
    said: dict[str, float] = {}
    while True:
        began_s = clock()
        try:
            await run()
            problem = "it ended"
        except Exception as error:  # noqa: BLE001 - whatever is wrong with one part, the others go on
            problem = f"{type(error).__name__}: {error}"
            _log(name, problem, error, said, clock())
        if clock() - began_s >= STABLE_S:
            backoff.reset()
        wait_s = backoff.next_s()
        log.debug("%s starts again in %.1f s: %s", name, wait_s, problem)
        await asyncio.sleep(wait_s)


def _log(name: str, problem: str, error: Exception, said: dict[str, float], now_s: float) -> None:
    last_s = said.get(problem)
    if last_s is not None and now_s - last_s < REPEAT_S:
        return
    if len(said) >= 16:  # errors whose text differs each time must not pile up
        said.clear()
    said[problem] = now_s
    log.error("%s failed and is started again; the other parts go on: %s", name, problem, exc_info=error)
