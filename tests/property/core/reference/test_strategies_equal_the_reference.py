"""Scoring strategies and formula versions that the default profile does not use, against the scalar reference."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.seeds import count_examples

from campaigns.cluster_cases import Case, cases
from campaigns.reference_scheduler import Config
from campaigns.reference_scheduler.comparison import build
from campaigns.reference_scheduler.nodes.resources import balance_score, fit_score
from campaigns.reference_scheduler.state import State
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import MAX_SCORE
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.plugins.kubernetes.node_resources.balanced_allocation import (
    BalancedArgs,
    NodeResourcesBalancedAllocation,
)
from robotapp_scheduler.plugins.kubernetes.node_resources.fit import FitArgs, NodeResourcesFit

FAMILIES = ("amounts", "extended", "pod-level", "init-steps", "overhead", "boxed-level", "resize")
UNRESIZED = tuple(family for family in FAMILIES if family != "resize")
RESOURCES = st.dictionaries(
    st.sampled_from(("cpu", "memory", "example.com/gpu", "ephemeral-storage")),
    st.integers(1, 5),
    min_size=1,
    max_size=4,
)
SHAPES = st.lists(st.tuples(st.integers(0, 100), st.integers(0, 10)), min_size=1, max_size=4, unique_by=lambda p: p[0])
CHECKS = settings(
    max_examples=count_examples(150),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
Rule = Callable[[State, list[dict[str, Any]]], dict[str, int] | None]


def expected(case: Case, rule: Rule, **config: Any) -> list[int | None]:
    cluster = case.cluster
    scores = rule(State.of(cluster, case.pod, Config(**config)), cluster.nodes)
    return [None if scores is None else scores[node["metadata"]["name"]] for node in cluster.nodes]


def found(case: Case, plugin: Any) -> list[int | None]:
    """Scores by columns, which must equal those of the row form."""
    core, info = build(case)
    columns = plugin.score(info, Snapshot(core.cluster))
    count = len(case.cluster.nodes)
    if columns is None:
        return [None] * count
    assert isinstance(columns, np.ndarray)
    assert plugin.sound, "the framework believes it without looking"
    assert columns.dtype == np.int64
    assert all(0 <= score <= MAX_SCORE for score in columns.tolist())
    assert columns.tolist() == [plugin.score_row(info, Row(core.cluster.nodes, row)) for row in range(count)]
    return list(columns.tolist())


def strategy(kind: str, resources: dict[str, int]) -> dict[str, Any]:
    return {"type": kind, "resources": [{"name": name, "weight": weight} for name, weight in resources.items()]}


@CHECKS
@given(cases(FAMILIES), RESOURCES, st.sampled_from(("LeastAllocated", "MostAllocated")))
def test_least_and_most_allocated_over_any_resources(case: Case, resources: dict[str, int], kind: str) -> None:
    fit = strategy(kind, resources)
    plugin = NodeResourcesFit(msgspec.convert({"scoringStrategy": fit}, FitArgs))
    assert found(case, plugin) == expected(case, fit_score, fit_strategy=fit)


@CHECKS
@given(cases(FAMILIES), RESOURCES, SHAPES)
def test_requested_to_capacity_ratio_with_any_shape(
    case: Case, resources: dict[str, int], points: list[tuple[int, int]]
) -> None:
    shape = [{"utilization": at, "score": score} for at, score in sorted(points)]
    fit = strategy("RequestedToCapacityRatio", resources) | {"requestedToCapacityRatio": {"shape": shape}}
    plugin = NodeResourcesFit(msgspec.convert({"scoringStrategy": fit}, FitArgs))
    assert found(case, plugin) == expected(case, fit_score, fit_strategy=fit)


# What a resized placed pod holds changed between the versions too: that is the cluster's count, not this plugin's formula.
@CHECKS
@given(cases(UNRESIZED), RESOURCES, st.sampled_from(("1.35", "1.37")))
def test_balance_over_any_resources_in_both_versions(case: Case, resources: dict[str, int], compat: str) -> None:
    args = {"resources": [{"name": name, "weight": 1} for name in resources], "compatVersion": compat}
    plugin = NodeResourcesBalancedAllocation(msgspec.convert(args, BalancedArgs))
    names = tuple(resources)
    assert found(case, plugin) == expected(case, balance_score, balanced_resources=names, compat_version=compat)
