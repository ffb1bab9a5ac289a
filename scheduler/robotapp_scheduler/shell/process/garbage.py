"""The garbage collector's share. What we keep is decoded objects without cycles, in the hundreds of thousands.

With Python's defaults they are walked again and again: a fifth of the cold start, a tenth of a burst, and pauses of tens
of milliseconds between a pod and its bind. So an object is walked once, in small lots, and set aside if it survived.
What becomes a cycle later (an exception with its stack, a task) is few and small, and found once an hour.
"""

import asyncio
import gc
from typing import Any, Final

FILLING: Final = (500_000, 10, 10)
"""While the initial lists are read nearly everything stays, there is nothing to find."""
LOT: Final = 5_000
"""So many objects more than were freed make a lot; walking it takes a millisecond or two."""
PERIOD_S: Final = 3600.0
DEFAULTS: Final = (700, 10, 10)


def filling() -> None:
    """The caches are about to be filled."""
    gc.set_threshold(*FILLING)


def filled() -> None:
    """What is there now lives as long as we do: the collector need not walk it again."""
    thorough()
    if _set_aside not in gc.callbacks:
        gc.callbacks.append(_set_aside)
    gc.set_threshold(LOT, 10, 10)


def released() -> None:
    """Python's own ways again, for a process that goes on after us."""
    if _set_aside in gc.callbacks:
        gc.callbacks.remove(_set_aside)
    gc.set_threshold(*DEFAULTS)
    gc.unfreeze()


async def run() -> None:
    """Look at everything once an hour, until cancelled."""
    while True:
        await asyncio.sleep(PERIOD_S)
        thorough()


def thorough() -> None:
    """Walk all there is, whatever was set aside as well: a tenth of a second and more in a large cluster."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def _set_aside(phase: str, _: dict[str, Any]) -> None:
    if phase == "stop":
        gc.freeze()
