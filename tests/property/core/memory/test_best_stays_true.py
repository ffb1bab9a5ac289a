"""The rows with the highest total, kept while totals change one by one, are those of a fresh look."""

from typing import Final

import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.runtime.ranking import Hashes, TopRows, mixed

HASHES: Final = np.array([(i * 0x9E3779B97F4A7C15) % 2**64 for i in range(24)], dtype=np.uint64)
TOTALS: Final = st.lists(st.integers(0, 3), min_size=1, max_size=24)
CHANGES: Final = st.lists(st.tuples(st.integers(0, 23), st.integers(-1, 5), st.integers(0, 2**64 - 1)), max_size=60)


def truly_best(best: TopRows, total: npt.NDArray[np.int64], hashes: Hashes, pod: int) -> None:
    if total.max() < 0:
        return  # nobody asks while no row is feasible
    fresh = np.flatnonzero(total == total.max())
    assert best.top == total.max()
    assert len(best) == len(fresh)
    feasible = np.flatnonzero(total >= 0)
    better_first = feasible[np.argsort(-total[feasible], kind="stable")].tolist()
    for count in {min(3, len(feasible)), len(feasible)}:
        assert best.first(count) == tuple(better_first[:count])
    assert best.choose(pod) == fresh[mixed(hashes[fresh], pod).argmin()]


@given(totals=TOTALS, steps=st.lists(CHANGES, max_size=6))
def test_it_may_be_told_of_several_changes_at_once(totals: list[int], steps: list[list[tuple[int, int, int]]]) -> None:
    total = np.array(totals, dtype=np.int64)
    hashes = HASHES[: len(totals)]
    best = TopRows(total, hashes)
    for step in steps:
        after = {row % len(totals): value for row, value, _ in step}
        before = [total.item(position) for position in after]
        total[[*after]] = [*after.values()]
        if not best.all_changed(after, before, after.values()):
            best = TopRows(total, hashes)
        truly_best(best, total, hashes, len(step))


@given(totals=TOTALS, changes=CHANGES)
def test_best_rows_that_are_told_of_every_change_equal_those_made_anew(
    totals: list[int], changes: list[tuple[int, int, int]]
) -> None:
    total = np.array(totals, dtype=np.int64)
    hashes = HASHES[: len(totals)]
    best = TopRows(total, hashes)
    for row, value, pod in changes:
        position = row % len(totals)
        before, total[position] = total.item(position), value
        if not best.all_changed([position], [before], [value]):
            best = TopRows(total, hashes)
        truly_best(best, total, hashes, pod)
