"""A problem carries the measured pairs that its pods can have, and no plan sees a difference."""

from itertools import pairwise
from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.joint_problems import latencies

RANDOM = st.integers(0, 2**32).map(Random)


@settings(deadline=None)
@given(RANDOM)
def test_every_round_trip_that_a_plan_can_have_stays_as_it_is(random: Random) -> None:
    pods, rows = random.randint(2, 5), random.randint(1, 12)
    rtt = latencies(random, rows=rows, zones=random.randint(1, 3), measured=random.randint(0, 40))
    likely = [random.choice((0.1, 0.5, 1.0)) for _ in range(pods)]
    possible = np.array([[random.random() < share for _ in range(rows)] for share in likely])
    edges = [pair for pair in pairwise(range(pods)) if random.random() < 0.7]
    fewer = rtt.between(possible, edges)
    for one, other in edges:
        for which in (0, 1):
            for row in np.flatnonzero(possible[one]):
                there = possible[other]
                np.testing.assert_array_equal(fewer.row(int(row), which)[there], rtt.row(int(row), which)[there])


def test_pods_on_two_nodes_need_no_pair_of_others() -> None:
    rtt = latencies(Random(3), rows=40, zones=3, measured=400)
    possible = np.zeros((3, 40), dtype=np.bool_)
    possible[0, 7] = possible[1, 9] = True
    possible[2] = True
    kept = rtt.between(possible, [(0, 1), (2, 0)]).measured
    assert {*kept.left.tolist()} > {7}
    assert all(7 in pair for pair in zip(kept.left.tolist(), kept.right.tolist(), strict=True))
    assert len(kept.left) == 2 * int((rtt.measured.left == 7).sum())
    assert rtt.between(np.ones((3, 40), dtype=np.bool_), [(0, 1)]) is rtt
