"""Waiting pods are asked about once when they are equal in `hint_reads`: so for them every hint answers the same."""

from itertools import combinations
from random import Random
from typing import Any

import pytest
from tests.support.scheduling import make_info, make_pod

from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.plugins.kubernetes.topology.inter_pod_affinity import InterPodAffinity
from robotapp_scheduler.plugins.kubernetes.topology.pod_topology_spread import PodTopologySpread

WHEN = "requiredDuringSchedulingIgnoredDuringExecution"


def labels(random: Random) -> dict[str, str]:
    return {"app": random.choice("ab"), "tier": random.choice("xy"), "ordinal": str(random.randrange(3))}


def company(random: Random) -> dict[str, Any]:
    selector = {"matchLabels": {"app": random.choice("ab")}}
    term = {"topologyKey": "zone", "labelSelector": selector}
    kind = random.choice(["podAffinity", "podAntiAffinity"])
    spread = {**term, "maxSkew": 1, "matchLabelKeys": random.choice([[], ["tier"]])}
    return random.choice([{}, {"affinity": {kind: {WHEN: [term]}}}, {"topologySpreadConstraints": [spread]}])


def event(random: Random) -> Event:
    one, two = (make_pod("other", node="n1", labels=labels(random), **company(random)) for _ in range(2))
    change, old, new = random.choice(
        [(Change.POD_ADDED, None, one), (Change.POD_REMOVED, one, None), (Change.POD_UPDATED, one, two)]
    )
    return Event("pods", change, old, new)


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("plugin", [PodTopologySpread(), InterPodAffinity()], ids=["spread", "affinity"])
def test_pods_that_are_equal_in_them_get_the_same_answer(plugin: Any, seed: int) -> None:
    random, queueing_hint, compared = Random(seed), RegisteredPlugin(plugin).queueing_hint, 0
    pods = [make_info(f"p{i}", labels=labels(random), **company(random)) for i in range(30)]
    for seen in [event(random) for _ in range(20)]:
        if queueing_hint.of_each is not None and queueing_hint.of_each(seen):
            continue
        for left, right in combinations(pods, 2):
            if queueing_hint.key(left) == queueing_hint.key(right):
                compared += 1
                assert queueing_hint.wants(left, seen) == queueing_hint.wants(right, seen)
    assert compared
