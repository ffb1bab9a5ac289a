"""A fixed piece of work like the scheduler's own, timed in the same run: costs in units of it hold on any machine."""

import time
from typing import Final

import numpy as np

ROUNDS = 100
TRIES = 5
REFERENCE_US: Final = 55.0
"""A unit on the machine on which limits in seconds were set, when it was idle."""


def unit_us() -> float:
    """CPU µs of one unit: a hundred small objects into a dict, ten passes over a column of a thousand nodes; the best of five."""
    column = np.arange(1000)
    return min(_timed(column) for _ in range(TRIES))


def is_within(used_s: float, most_s: float) -> bool:
    """Is this CPU time at most `most_s`, or what comes to it here and now? A core whose other half is busy counts twice the time."""
    if used_s <= most_s:
        return True
    column = np.arange(1000)
    return used_s <= most_s * sum(_timed(column) for _ in range(TRIES)) / TRIES / REFERENCE_US


def is_in_time(took_s: float, most_s: float) -> bool:
    """Did this take at most `most_s` by the clock, or what comes to it here and now?"""
    return took_s <= most_s or took_s <= most_s * slowness()


def slowness(*, seconds: float = 1.0) -> float:
    """How many times as long a unit takes by the clock as on that machine, at least 1: for limits in seconds where the
    processor is slower or other programs run. Takes `seconds`."""
    column = np.arange(1000)
    rounds = 0
    began_s = time.monotonic()
    while (took_s := time.monotonic() - began_s) < seconds:
        _timed(column)
        rounds += ROUNDS
    return max(1.0, 1e6 * took_s / max(rounds, 1) / REFERENCE_US)


def _timed(column: "np.ndarray[tuple[int], np.dtype[np.int64]]") -> float:
    began_s = time.process_time()
    for _ in range(ROUNDS):
        found = {}
        for number in range(100):
            found[str(number)] = (number, [number])
        for _ in range(10):
            int(np.argmax(np.where(column > 10, column * 3, 0)))
    return 1e6 * (time.process_time() - began_s) / ROUNDS
