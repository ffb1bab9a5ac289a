"""The garbage collector's share. What we keep is decoded objects without cycles, in the hundreds of thousands.

With Python's defaults they are walked again and again: a fifth of the cold start, a tenth of a burst, and pauses between
a pod and its bind. Cycles (tasks, exceptions) are few and small and may wait.
"""

import gc
from typing import Final

FILLING: Final = (500_000, 10, 10)
"""While the initial lists are read nearly everything stays, there is nothing to find."""
RUNNING: Final = (50_000, 10, 10)
"""So many objects more than were freed since the last collection; walking them takes a few milliseconds."""


def filling() -> None:
    """The caches are about to be filled."""
    gc.set_threshold(*FILLING)


def filled() -> None:
    """What is there now lives as long as we do: the collector need not walk it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*RUNNING)
