"""Scoring strategies and formula versions that the default profile does not use, against the scalar reference."""

from typing import Any

import msgspec
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.reference_scheduler import scores
from tests.support.scheduling import make_cluster, to_node, to_pod
from tests.support.scheduling_cases import worlds

from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes, Row
from robotapp_scheduler.plugins.kubernetes.balanced_allocation import BalancedArgs, NodeResourcesBalancedAllocation
from robotapp_scheduler.plugins.kubernetes.resources_fit import FitArgs, NodeResourcesFit

Json = dict[str, Any]
RESOURCES = st.dictionaries(
    st.sampled_from(("cpu", "memory", "nvidia.com/gpu", "ephemeral-storage")), st.integers(1, 5), min_size=1, max_size=4
)
SHAPES = st.lists(st.tuples(st.integers(0, 100), st.integers(0, 10)), min_size=1, max_size=4, unique_by=lambda p: p[0])
CHECKS = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)


def expected(world: tuple[list[Json], list[Json], Json], rule: Any) -> list[int | None]:
    nodes, placed, pod = world
    names = [node["metadata"]["name"] for node in nodes]
    on = {name: [other for other in placed if other["spec"]["nodeName"] == name] for name in names}
    return [rule(pod, node, on[node["metadata"]["name"]]) for node in nodes]


def found(world: tuple[list[Json], list[Json], Json], plugin: Any) -> list[int | None]:
    """Scores by columns, which must equal those of the row form."""
    nodes, placed, pod = world
    cluster = make_cluster(*(to_node(node) for node in nodes))
    for other in placed:
        cluster.apply_pod(to_pod(other))
    info = PodInfo(to_pod(pod))
    columns = plugin.score(info, Nodes(cluster))
    if columns is None:
        return [None] * len(nodes)
    assert isinstance(columns, np.ndarray)
    assert columns.tolist() == [plugin.score_row(info, Row(cluster.nodes, row)) for row in range(len(nodes))]
    return list(columns.tolist())


@CHECKS
@given(worlds(), RESOURCES, st.sampled_from(("LeastAllocated", "MostAllocated")))
def test_least_and_most_allocated_over_any_resources(world: Any, resources: dict[str, int], kind: str) -> None:
    strategy = {"type": kind, "resources": [{"name": name, "weight": w} for name, w in resources.items()]}
    plugin = NodeResourcesFit(msgspec.convert({"scoringStrategy": strategy}, FitArgs))
    rule = scores.least_allocated if kind == "LeastAllocated" else scores.most_allocated
    assert found(world, plugin) == expected(world, lambda *args: rule(*args, resources))


@CHECKS
@given(worlds(), RESOURCES, SHAPES)
def test_requested_to_capacity_ratio_with_any_shape(
    world: Any, resources: dict[str, int], points: list[tuple[int, int]]
) -> None:
    shape = sorted(points)
    strategy = {
        "type": "RequestedToCapacityRatio",
        "resources": [{"name": name, "weight": weight} for name, weight in resources.items()],
        "requestedToCapacityRatio": {"shape": [{"utilization": at, "score": score} for at, score in shape]},
    }
    plugin = NodeResourcesFit(msgspec.convert({"scoringStrategy": strategy}, FitArgs))
    assert found(world, plugin) == expected(world, lambda *args: scores.capacity_ratio(*args, shape, resources))


@CHECKS
@given(worlds(), RESOURCES, st.sampled_from(("1.35", "1.37")))
def test_balance_over_any_resources_in_both_versions(world: Any, resources: dict[str, int], compat: str) -> None:
    args = {"resources": [{"name": name, "weight": 1} for name in resources], "compatVersion": compat}
    plugin = NodeResourcesBalancedAllocation(msgspec.convert(args, BalancedArgs))
    change = compat == "1.37"
    assert found(world, plugin) == expected(
        world, lambda *args: scores.balanced(*args, tuple(resources), change=change)
    )
