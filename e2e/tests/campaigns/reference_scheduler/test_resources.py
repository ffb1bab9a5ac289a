"""Fit and balance by hand."""

from typing import Any

import pytest

from campaigns.cluster_cases.scene import make_node, make_pod
from campaigns.reference_scheduler import ClusterDump, Config, Decision, decide
from campaigns.reference_scheduler.nodes.resources import on_shape

Json = dict[str, Any]


def run(pod: Json, *nodes: Json, placed: tuple[Json, ...] = (), **config: Any) -> Decision:
    return decide(ClusterDump(nodes=list(nodes), pods=list(placed)), pod, Config(**config))


def two() -> tuple[Json, Json]:
    """4 cores and 8 GiB, and 1 core and 8 GiB."""
    return make_node("a"), make_node("b", cpu="1")


def strategy(kind: str, *, shape: tuple[tuple[int, int], ...] = (), **weights: int) -> Json:
    found: Json = {"type": kind, "resources": [{"name": name, "weight": weight} for name, weight in weights.items()]}
    points = [{"utilization": at, "score": score} for at, score in shape]
    return found | {"requestedToCapacityRatio": {"shape": points}}


def test_every_shortage_is_told_and_only_hopeless_ones_are_final() -> None:
    full = make_node("a", cpu="1", pods="1")
    decision = run(make_pod("p", cpu="500m", memory="9Gi"), full, placed=(make_pod("o", node="a", cpu="600m"),))
    assert decision.rejections["a"].texts == ("Too many pods", "Insufficient cpu", "Insufficient memory")
    assert decision.rejections["a"].final
    decision = run(make_pod("p", cpu="500m"), full, placed=(make_pod("o", node="a", cpu="600m"),))
    assert decision.rejections["a"].texts == ("Too many pods", "Insufficient cpu")
    assert not decision.rejections["a"].final


def test_no_room_for_pods_is_never_final() -> None:
    decision = run(make_pod("p"), make_node("a", pods="0"))
    assert decision.message == (
        "0/1 nodes are available: 1 Too many pods. "
        "preemption: 0/1 nodes are available: 1 No preemption victims found for incoming pod."
    )


def test_an_extended_resource_no_node_has_is_final_unless_it_is_ignored() -> None:
    pod = make_pod("p")
    pod["spec"]["containers"][0]["resources"]["requests"]["example.com/gpu"] = "1"
    assert run(pod, make_node("a")).rejections["a"].texts == ("Insufficient example.com/gpu",)
    assert run(pod, make_node("a"), ignored_resources=("example.com/gpu",)).feasible == ["a"]
    assert run(pod, make_node("a"), ignored_resource_groups=("example.com",)).feasible == ["a"]


def test_pods_that_have_ended_hold_nothing_and_terminating_ones_hold_everything() -> None:
    old = make_pod("o", node="a", cpu="4")
    old["status"]["phase"] = "Succeeded"
    assert run(make_pod("p"), make_node("a"), placed=(old,)).feasible == ["a"]
    old["status"]["phase"] = "Running"
    old["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    assert run(make_pod("p"), make_node("a"), placed=(old,)).feasible == []


def test_least_allocated_is_the_mean_of_what_is_left() -> None:
    decision = run(make_pod("p", cpu="2", memory="2Gi"), make_node("a"), make_node("b", cpu="8"))
    # a: cpu 50, memory 75 -> 62; b: cpu 75, memory 75.
    assert decision.raw["NodeResourcesFit"] == {"a": 62, "b": 75}


def test_most_allocated_with_weights() -> None:
    fit = strategy("MostAllocated", cpu=3, memory=1)
    decision = run(make_pod("p", cpu="1", memory="2Gi"), *two(), fit_strategy=fit)
    # The means are 100 by 4 and 325 by 4.
    assert decision.raw["NodeResourcesFit"] == {"a": 25, "b": 81}


def test_the_ratio_leaves_zero_scores_out_and_rounds_half_away_from_zero() -> None:
    fit = strategy("RequestedToCapacityRatio", shape=((0, 0), (100, 10)), cpu=1, memory=1)
    decision = run(
        make_pod("p", cpu="2", memory="2Gi"), make_node("a"), make_node("b", memory="2000Gi"), fit_strategy=fit
    )
    # a: 50 and 25 -> 37.5 -> 38; b: 50 alone, memory scores 0.
    assert decision.raw["NodeResourcesFit"] == {"a": 38, "b": 50}


@pytest.mark.parametrize(("at", "expected"), [(0, 100), (10, 100), (11, 99), (55, 50), (99, 2), (100, 0), (50, 56)])
def test_falling_segments_round_towards_zero(at: int, expected: int) -> None:
    # 100 + (-100 * (at - 10)) / 90 with the quotient cut: at 11 it is -1, at 50 -44, at 99 -98.
    assert on_shape(((10, 10), (100, 0)), at) == expected


def test_resources_a_node_lacks_and_extended_ones_the_pod_does_not_ask_for_are_left_out() -> None:
    fit = strategy("LeastAllocated", cpu=1, **{"example.com/gpu": 9, "ephemeral-storage": 1})
    bare = make_node("b")
    del bare["status"]["allocatable"]["ephemeral-storage"]
    decision = run(make_pod("p", cpu="2"), make_node("a"), bare, fit_strategy=fit)
    # a: cpu 50, storage 100 -> 75; b: cpu 50 alone.
    assert decision.raw["NodeResourcesFit"] == {"a": 75, "b": 50}


def test_balance_scores_the_change_since_1_36_and_the_state_before() -> None:
    pod = make_pod("p", cpu="2", memory="2Gi")
    # With the pod 0.5 and 0.25: std 0.125, 87; empty 100: 50 + (50 + 87 - 100) // 2 = 68. b: 0.25 and 0.25: 100 and 75.
    nodes = (make_node("a"), make_node("b", cpu="8"))
    assert run(pod, *nodes).raw["NodeResourcesBalancedAllocation"] == {"a": 68, "b": 75}
    old = run(pod, *nodes, compat_version="1.35").raw["NodeResourcesBalancedAllocation"]
    assert old == {"a": 87, "b": 100}


def test_balance_can_get_better_than_before() -> None:
    pod = make_pod("p", cpu="0", memory="4Gi")
    # Before 0.5 and 0: 75. After 0.5 and 0.5: 100. 50 + (50 + 25) // 2 = 87.
    decision = run(pod, make_node("a"), make_node("b"), placed=(make_pod("o", node="a", cpu="2", memory="0"),))
    assert decision.raw["NodeResourcesBalancedAllocation"]["a"] == 87


def test_balance_of_three_resources_uses_the_standard_deviation() -> None:
    pod = make_pod("p", cpu="2", memory="2Gi")
    # 0.5, 0.25, 0: mean 0.25, std 0.2041: 79 in 1.35.
    decision = run(
        pod,
        make_node("a"),
        make_node("b"),
        compat_version="1.35",
        balanced_resources=("cpu", "memory", "ephemeral-storage"),
    )
    assert decision.raw["NodeResourcesBalancedAllocation"]["a"] == 79


def test_balance_is_skipped_for_a_pod_that_asks_for_nothing() -> None:
    assert "NodeResourcesBalancedAllocation" not in run(make_pod("p", cpu="0", memory="0"), *two()).raw
