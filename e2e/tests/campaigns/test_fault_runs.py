"""The stage of a fault run holds what its plan promises, and a wait for binds ends where no more can come."""

import asyncio
import random
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.faults import campaign
from campaigns.faults.history import History, Known, Room
from campaigns.faults.observer import CPU_LABEL
from campaigns.faults.run import Plan, Run


class Watched:
    def __init__(self, history: History) -> None:
        self.history = history


def run(history: History, *, pods: int) -> Run:
    return Run(
        Plan("none", pods, seed=1, room=1.0), *cast(Any, (None, None, None, Watched(history), None, random.Random(1)))
    )


@given(pods=st.integers(1, 2000), room=st.sampled_from([0.5, 0.99, 1.1]), seed=st.integers(0, 9))
def test_the_nodes_of_a_run_hold_the_part_of_the_pods_that_its_plan_names(pods: int, room: float, seed: int) -> None:
    plan = Plan("none", pods, seed, room)
    made = campaign._pods(plan, random.Random(seed), prefix="p")
    asked_milli = sum(int(pod["metadata"]["labels"][CPU_LABEL]) for pod in made)
    nodes = campaign._rooms(plan, made)
    held_milli = sum(node.cpu_milli for node in nodes.values())
    assert asked_milli * room - 1 - len(nodes) < held_milli <= asked_milli * room
    assert all(node.cpu_milli <= campaign.NODE_CPU_MILLI for node in nodes.values())


async def test_a_wait_for_binds_ends_once_every_other_pod_was_told_that_it_does_not_fit() -> None:
    history = History({"n0": Room(pods=2, cpu_milli=150)})
    history.seen("a", Known("a", 100, "n0"))
    history.seen("b", Known("b", 100, reported="Unschedulable"))
    async with asyncio.timeout(30):
        await run(history, pods=2).bound(1.0)


async def test_a_wait_for_binds_goes_on_while_a_pod_was_told_nothing() -> None:
    history = History({"n0": Room(pods=2, cpu_milli=150)})
    history.seen("a", Known("a", 100, "n0"))
    history.seen("b", Known("b", 100))
    with pytest.raises(TimeoutError, match="1 of 2 binds"):
        await run(history, pods=2).bound(1.0, within_s=0.0)
