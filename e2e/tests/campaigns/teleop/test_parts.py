"""The parts around a deployment: the machine's load, the residents of the nodes."""

from hypothesis import given
from hypothesis import strategies as st

from campaigns.teleop.cluster import make_resident
from campaigns.teleop.design import FAR, NEAR
from campaigns.teleop.machine import CpuTimes, parse_cpu_times

TICKS = st.lists(st.integers(0, 10**9), min_size=8, max_size=8).map(tuple)


def test_load_is_what_is_neither_idle_nor_waiting_for_a_disk() -> None:
    before = parse_cpu_times("cpu  100 0 50 800 50 0 0 0 7 7\ncpu0 1 2 3 4\n")
    after = parse_cpu_times("cpu  160 0 60 820 55 0 0 5 9 9\n")
    load = before.describe_load(after, average=1.234)
    assert (load.average, load.busy_share, load.steal_share) == (1.23, 0.75, 0.05)


@given(TICKS, TICKS)
def test_shares_of_the_load_are_shares(ticks: tuple[int, ...], spent: tuple[int, ...]) -> None:
    later = CpuTimes(tuple(one + other for one, other in zip(ticks, spent, strict=True)))
    load = CpuTimes(ticks).describe_load(later, average=0.0)
    assert 0 <= load.steal_share <= load.busy_share <= 1


def test_residents_differ_in_name_and_node_alone_and_request_nothing() -> None:
    near, far = make_resident(NEAR), make_resident(FAR)
    assert (near["spec"].pop("nodeName"), far["spec"].pop("nodeName")) == (NEAR, FAR)
    assert near["spec"] == far["spec"]
    assert "resources" not in near["spec"]["containers"][0]
