"""A pod without ROS fields is decided the same with all ROS plugins as without any, whatever robots are around it."""

import random

from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduling import make_info

from campaigns.cluster_cases import seeded_case
from campaigns.parity.offline import both, compare_without_ros_plugins, decided
from robotapp_scheduler.plugins.kubernetes.queue_sort import PrioritySort
from robotapp_scheduler.plugins.ros.queue_sort import ROSQueueSort

SAMPLE = 300
PRIORITIES = st.integers(-(2**31), 2**31 - 1)
PODS = st.lists(st.tuples(PRIORITIES, st.integers(0, 10**6)), min_size=2, max_size=6, unique_by=lambda each: each[1])


def test_three_hundred_seeded_cases_are_decided_the_same() -> None:
    """Another three hundred in every run; `scripts/bench parity --ros-plugins --seed S` shows them again."""
    seed = str(random.randrange(10**6))
    report = compare_without_ros_plugins(cases=SAMPLE, seed=seed, say=lambda _: None)
    assert report.found == [], f"--seed {seed}"
    assert report.compared["bound"] > SAMPLE // 4
    assert report.compared["refused"] > SAMPLE // 4


def test_the_surroundings_do_matter_to_a_pod_with_ros_fields() -> None:
    """Else the comparison would prove nothing: the same pod with a budget is decided otherwise by the ROS plugins."""
    unequal = 0
    for number in range(30):
        case = seeded_case("1", number=number, families=["cordons"])
        policies = '{"latency_budget": "3ms"}'
        annotations = {
            "scheduler.robotics.io/policies": policies,
            "scheduler.robotics.io/topology": '{"master_node": "n0"}',
        }
        case.objects[-1]["metadata"]["annotations"] = annotations
        with_ros, without = (decided(core, case) for core in both(case))
        unequal += with_ros["nodes"] != without["nodes"]
    assert unequal > 10


@given(PODS)
def test_pods_leave_the_queue_in_the_same_order(pods: list[tuple[int, int]]) -> None:
    infos = [(make_info(f"p{at}", priority=priority), float(at_s)) for at, (priority, at_s) in enumerate(pods)]
    orders = [
        [info.key for info, _ in sorted(infos, key=lambda each, sort=sort: sort.queue_key(*each))]  # type: ignore[misc]
        for sort in (ROSQueueSort(), PrioritySort())
    ]
    assert orders[0] == orders[1]
