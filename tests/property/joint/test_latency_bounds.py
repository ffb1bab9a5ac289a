"""The bounds by which plans leave out nodes that were not looked at one by one hold for every pair of nodes."""

from random import Random

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.joint_problems import latencies


@given(st.integers(0, 2**32 - 1))
def test_no_pair_is_outside_the_bounds_of_its_groups(seed: int) -> None:
    random = Random(seed)
    rtt = latencies(random, rows=random.randint(2, 25), zones=random.randint(1, 20), measured=random.randint(0, 40))
    for which in (0, 1):
        lowest, doubt = rtt.floor(which)
        for node in range(rtt.size):
            row = rtt.row(node, which)
            others = np.arange(rtt.size) != node
            bound, unsure = lowest[rtt.group[node]][rtt.group], doubt[rtt.group[node]][rtt.group]
            unknown = np.isnan(row)
            assert (row[others & ~unknown] >= bound[others & ~unknown]).all()
            assert unsure[unknown].all()
            assert (row[np.isfinite(row)] <= rtt.most(which)).all()


@given(st.integers(0, 2**32 - 1))
def test_rows_are_symmetric(seed: int) -> None:
    random = Random(seed)
    rtt = latencies(random, rows=8, zones=3, measured=6)
    for which in (0, 1):
        table = np.stack([rtt.row(node, which) for node in range(rtt.size)])
        np.testing.assert_array_equal(table, table.T)
