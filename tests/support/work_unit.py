"""A fixed piece of work like the scheduler's own, timed in the same run: costs in units of it hold on any machine."""

import time

import numpy as np

ROUNDS = 100
TRIES = 5


def unit_us() -> float:
    """CPU µs of one unit: a hundred small objects into a dict, ten passes over a column of a thousand nodes; the best of five."""
    column = np.arange(1000)
    return min(_timed(column) for _ in range(TRIES))


def _timed(column: "np.ndarray[tuple[int], np.dtype[np.int64]]") -> float:
    began_s = time.process_time()
    for _ in range(ROUNDS):
        found = {}
        for number in range(100):
            found[str(number)] = (number, [number])
        for _ in range(10):
            int(np.argmax(np.where(column > 10, column * 3, 0)))
    return 1e6 * (time.process_time() - began_s) / ROUNDS
