"""`placement.fallback` over random apps, nodes and times: what is held is met, and what is given up costs no place."""

import math
from collections.abc import Mapping
from datetime import timedelta
from itertools import combinations
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.scheduler.fallback_apps import ROBOT, START, Day, core_of, decide, give_app, give_pod, places, prefer
from tests.support.scheduling import app_object, chain, make_cluster, make_node, member_pod
from tests.support.seeds import count_examples

from robotapp_scheduler.core.api.robotics_v1alpha1 import Fallback
from robotapp_scheduler.core.robotics.app_index import read_app
from robotapp_scheduler.core.robotics.fallback import LATEST, held_until, relaxes_after_s

STEPS = st.lists(st.sampled_from(("RelaxPreferred", "Wait")), max_size=8)
SECONDS = st.integers(0, 3600)
BUDGET_MS = 30


# --- The rule -------------------------------------------------------------------------------------------------------


@given(STEPS, SECONDS)
def test_a_step_begins_after_all_before_it_and_without_it_nothing_is_relaxed(steps: list[str], after: int) -> None:
    found = relaxes_after_s(Fallback(steps=tuple(steps), after=f"{after}s"))
    if "RelaxPreferred" in steps:
        assert found == after * (steps.index("RelaxPreferred") + 1)
    else:
        assert found == math.inf
    assert relaxes_after_s(None) == 0.0


@given(
    STEPS, SECONDS, st.lists(SECONDS, min_size=1, max_size=4), st.lists(SECONDS, min_size=2, max_size=6), st.booleans()
)
def test_budgets_are_held_from_the_youngest_waiting_pod_on_and_once_only(
    steps: list[str], after: int, ages: list[int], moments: list[int], preferred: bool
) -> None:
    names = [f"c{i}" for i in range(len(ages))] + ["other"]
    edge = prefer("c0", "other", enforce="Preferred" if preferred else "Required")
    fallback = {"steps": steps, "after": f"{after}s"}
    source = app_object(*({"name": name} for name in names), edges=[edge], placement={"fallback": fallback})
    cluster, app = make_cluster(), read_app(source)
    cluster.apply_app(source)
    for name, age in zip(names, ages, strict=False):
        for owned in chain(name):
            cluster.apply_owner(owned)
        pod = member_pod(name, instance=ROBOT)
        pod.metadata.creation_timestamp = (START + timedelta(seconds=age)).isoformat()
        cluster.apply_pod(pod)
    start = START + timedelta(seconds=max(ages))

    def at(moment: int) -> bool:
        return held_until(app, ROBOT, cluster.apps, lambda: start + timedelta(seconds=moment)) is not None

    lasts_s = relaxes_after_s(Fallback(steps=tuple(steps), after=f"{after}s")) if preferred else 0.0
    assert [at(moment) for moment in sorted(moments)] == [moment < lasts_s for moment in sorted(moments)]
    if lasts_s == math.inf:
        assert held_until(app, ROBOT, cluster.apps, lambda: LATEST) == LATEST


# --- Apps -----------------------------------------------------------------------------------------------------------

TIMES = st.integers(1, 60)


@st.composite
def worlds(draw: st.DrawFn) -> dict[str, Any]:
    nodes = [f"n{i}" for i in range(draw(st.integers(1, 4)))]
    parts = [f"c{i}" for i in range(draw(st.integers(2, 4)))]
    return {
        "rtt": {pair: draw(TIMES) for pair in combinations(nodes, 2) if draw(st.booleans())},
        "nodes": {name: draw(st.sampled_from(("1", "2", "8"))) for name in nodes},
        "parts": parts,
        "edges": [
            prefer(
                *pair, budget=f"{BUDGET_MS}ms", enforce=draw(st.sampled_from(("Preferred", "Preferred", "Required")))
            )
            for pair in combinations(parts, 2)
            if draw(st.booleans())
        ],
        "gang": draw(st.sampled_from(("All", "None"))),
    }


def outcome(world: Mapping[str, Any], *, waited_s: float, fallback: Mapping[str, Any] | None) -> dict[str, str | None]:
    """Where the parts go in the first round after they have waited for so long."""
    rtt = {name: {b: ms for (a, b), ms in world["rtt"].items() if a == name} for name in world["nodes"]}
    core, day, _ = core_of([make_node(name, cpu=cpu) for name, cpu in world["nodes"].items()], rtt)
    placement = {"gang": world["gang"]} | ({"fallback": fallback} if fallback else {})
    give_app(core, *({"name": name} for name in world["parts"]), edges=world["edges"], **placement)
    made = Day()
    day.forward(waited_s)
    for name in world["parts"]:
        give_pod(core, made, name, cpu="900m")
    return places(decide(core))


def time_ms(world: Mapping[str, Any], one: str, other: str) -> float | None:
    return 0 if one == other else world["rtt"].get(tuple(sorted((one, other))))


@settings(max_examples=count_examples(60), deadline=None)
@given(worlds())
def test_pods_that_are_placed_while_budgets_are_held_meet_every_one_that_was_measured(world: dict[str, Any]) -> None:
    where = outcome(world, waited_s=0, fallback={"after": "10s"})
    for edge in world["edges"]:
        here, there = where[edge["from"]], where[edge["to"]]
        if here and there:
            ms = time_ms(world, here, there)
            assert ms is None or ms <= BUDGET_MS, (edge, where)


@settings(max_examples=count_examples(60), deadline=None)
@given(worlds())
def test_after_the_wait_an_app_is_placed_as_if_it_had_no_fallback(world: dict[str, Any]) -> None:
    assert outcome(world, waited_s=10, fallback={"after": "10s"}) == outcome(world, waited_s=10, fallback=None)


@settings(max_examples=count_examples(30), deadline=None)
@given(worlds())
def test_held_budgets_decide_as_required_ones_do(world: dict[str, Any]) -> None:
    required = [edge | {"latency": edge["latency"] | {"enforce": "Required"}} for edge in world["edges"]]
    strict = outcome({**world, "edges": required}, waited_s=0, fallback=None)
    assert outcome(world, waited_s=0, fallback={"steps": ["Wait"]}) == strict
