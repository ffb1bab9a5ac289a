"""PodGroups that compete: whole or not at all, no node over capacity, and nobody waits while a whole group would fit."""

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.pod_groups import announce, arrive, confirm, pod_group, run, team_pod
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scheduling import make_core, make_node

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore

SHAPES = st.lists(st.tuples(st.integers(1, 4), st.integers(0, 2)), min_size=1, max_size=3)
"""(minMember, pods beyond it) per group."""


def members(index: int, count: int) -> list[Pod]:
    return [team_pod(f"g{index}-{i}", group=f"g{index}", cpu="1") for i in range(count)]


def on_nodes(core: SchedulerCore, index: int) -> int:
    return sum(record.name.startswith(f"g{index}-") for record in core.cluster.placed.values())


def check_capacity(core: SchedulerCore, capacity: int) -> None:
    for name in core.cluster.nodes.row_of:
        assert len(list(core.cluster.pods_on(name))) <= capacity


def world(nodes: int, capacity: int, shapes: list[tuple[int, int]]) -> tuple[SchedulerCore, list[list[Pod]]]:
    core = make_core(*(make_node(f"n{i}", cpu=f"{capacity}500m") for i in range(nodes)))
    groups = [members(index, need + more) for index, (need, more) in enumerate(shapes)]
    for index, (need, _) in enumerate(shapes):
        announce(core, pod_group(f"g{index}", min_member=need))
    return core, groups


@settings(deadline=None)
@given(nodes=st.integers(0, 4), capacity=st.integers(1, 2), shapes=SHAPES, mixed=st.randoms(use_true_random=False))
def test_every_group_is_whole_or_nowhere_however_its_pods_arrive(
    nodes: int, capacity: int, shapes: list[tuple[int, int]], mixed: Random
) -> None:
    core, groups = world(nodes, capacity, shapes)
    pods = [pod for group in groups for pod in group]
    mixed.shuffle(pods)
    for pod in pods:
        arrive(core, pod)
        if mixed.random() < 0.3:
            run(core)
    run(core)
    check_queue(core.queue)
    check_capacity(core, capacity)
    free = nodes * capacity - sum(on_nodes(core, index) for index in range(len(shapes)))
    for index, (need, _) in enumerate(shapes):
        placed = on_nodes(core, index)
        assert placed == 0 or placed >= need
        assert placed > 0 or free < need, "room for the whole group, and yet it waits"


@settings(deadline=None)
@given(nodes=st.integers(2, 5), shapes=st.lists(st.tuples(st.integers(2, 3), st.just(0)), min_size=2, max_size=2),
       lost=st.sets(st.sampled_from([f"g{g}-{i}" for g in range(2) for i in range(3)])))  # fmt: skip
def test_two_groups_with_failed_binds_never_keep_each_others_last_places(
    nodes: int, shapes: list[tuple[int, int]], lost: set[str]
) -> None:
    """Whatever the failed binds left: a retry completes a group, or takes no place at all."""
    core, groups = world(nodes, 1, shapes)
    pods = [pod for group in groups for pod in group]
    arrive(core, *pods)
    run(core, lose=lost)
    confirm(core, pods)
    before = [on_nodes(core, index) for index in range(2)]
    core.queue.activate([pod.metadata.uid for pod in pods])
    run(core)
    after = [on_nodes(core, index) for index in range(2)]
    for index, (need, _) in enumerate(shapes):
        assert after[index] == before[index] or after[index] >= need
    check_capacity(core, 1)
    if after == before and min(after[i] - need for i, (need, _) in enumerate(shapes)) < 0:
        free = nodes - sum(after)
        assert all(free < need - after[index] for index, (need, _) in enumerate(shapes) if after[index] < need)
