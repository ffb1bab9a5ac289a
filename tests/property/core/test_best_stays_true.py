"""The rows with the highest total, kept while totals change one by one, are those of a fresh look."""

from typing import Final

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.best import Best, mixed

HASHES: Final = np.array([(i * 0x9E3779B97F4A7C15) % 2**64 for i in range(12)], dtype=np.uint64)
TOTALS: Final = st.lists(st.integers(0, 3), min_size=1, max_size=12)
CHANGES: Final = st.lists(st.tuples(st.integers(0, 11), st.integers(-1, 4), st.integers(0, 2**64 - 1)), max_size=40)


@given(totals=TOTALS, changes=CHANGES)
def test_best_rows_that_are_told_of_every_change_equal_those_made_anew(
    totals: list[int], changes: list[tuple[int, int, int]]
) -> None:
    total = np.array(totals, dtype=np.int64)
    hashes = HASHES[: len(totals)]
    best = Best(total, hashes)
    for row, value, pod in changes:
        position = row % len(totals)
        before, total[position] = total.item(position), value
        if not best.changed(position, before, value):
            best = Best(total, hashes)
        fresh = np.flatnonzero(total == total.max())
        assert best.top == total.max()
        assert len(best) == len(fresh)
        assert best.first(3) == tuple(fresh[:3].tolist())
        assert best.choose(pod) == fresh[mixed(hashes[fresh], pod).argmin()]
