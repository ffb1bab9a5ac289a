# ruff: noqa: ARG002 - example plugins keep the signature of the contract
"""What a plugin says per value of a label counts as if it had said it per node."""

from random import Random
from typing import Any

import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_info, make_node, make_pod

from robotapp_api.model.names import SCHEDULER_NAME, Label
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.interface import PerDomain, Verdict
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.registry import catalogue

ZONE = str(Label.ZONE)
LABELS = (ZONE, "example.com/rack")
MOST = 6


def pods_per_zone(nodes: Snapshot) -> Any:
    table = nodes.cluster.nodes
    found = np.zeros(len(nodes.label(ZONE).vocabulary.values), dtype=np.int64)
    for record in nodes.cluster.placed.values():
        found[table.labels.column(ZONE)[0][table.row_of[record.node]]] += 1
    return found


class PerZone:
    name = "ByZone"
    reads = ()
    node_reads = ("labels", "pods")
    normalize = "minmax"

    def filter(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return Verdict(pods_per_zone(nodes) < MOST, label=nodes.label(ZONE))

    def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return PerDomain(pods_per_zone(nodes), nodes.label(ZONE))


class PerNode(PerZone):
    def filter(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return (pods_per_zone(nodes) < MOST)[nodes.label(ZONE).codes]

    def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return pods_per_zone(nodes)[nodes.label(ZONE).codes]


def of_the_moment(nodes: Snapshot) -> tuple[Any, Any]:
    """Which label decides follows from the pods that are there, as with the preferences of others: its result per value, and it."""
    label = nodes.label(LABELS[len(nodes.cluster.placed) % 2])
    return np.arange(len(label.vocabulary.values)), label


class PerLabel(PerZone):
    def filter(self, pod: PodInfo, nodes: Snapshot) -> Any:
        values, label = of_the_moment(nodes)
        return Verdict(values != 1, label=label)

    def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
        return PerDomain(*of_the_moment(nodes))


class PerNodeOfLabel(PerZone):
    def filter(self, pod: PodInfo, nodes: Snapshot) -> Any:
        values, label = of_the_moment(nodes)
        return (values != 1)[label.codes]

    def score(self, pod: PodInfo, nodes: Snapshot) -> Any:
        values, label = of_the_moment(nodes)
        return values[label.codes]


def core_with(plugin: type) -> SchedulerCore:
    plugins = {"multiPoint": PluginSet(enabled=(PluginRef("ByZone", 7),))}
    profiles = build_profiles([ProfileSpec(SCHEDULER_NAME, plugins=plugins)], catalogue({"ByZone": plugin}))
    return SchedulerCore(make_cluster(), profiles, clock=Clock())


@pytest.mark.parametrize("seed", range(20))
def test_the_same_nodes_are_chosen_when_another_label_decides_than_before(seed: int) -> None:
    """Both labels change equally often, and may have equally many values: that does not make them the same one."""
    random, cores = Random(seed), [core_with(PerLabel), core_with(PerNodeOfLabel)]
    for number in range(6):
        labels = {
            key: random.choice(values)
            for key, values in zip(LABELS, ("abc", random.choice(("xyz", "vwxyz"))), strict=True)
        }
        for core in cores:
            core.cluster.apply_node(make_node(f"n{number}", labels=labels))
    for step in range(20):
        left, right = (core.schedule_one(make_info(f"p{step}")) for core in cores)
        assert (left.node, left.total, left.message) == (right.node, right.total, right.message)


@pytest.mark.parametrize("seed", range(20))
def test_the_same_nodes_are_chosen_while_pods_and_nodes_come_and_go(seed: int) -> None:
    random, cores = Random(seed), [core_with(PerZone), core_with(PerNode)]
    for step in range(60):
        if random.random() < 0.3:
            labels = {ZONE: random.choice("abc")} if random.random() < 0.8 else {}
            node = f"n{random.randrange(8)}"
            for core in cores:
                core.cluster.apply_node(make_node(node, labels=labels))
        elif random.random() < 0.2 and cores[0].cluster.placed:
            uid = random.choice(sorted(cores[0].cluster.placed))
            for core in cores:
                record = core.cluster.placed[uid]
                core.cluster.remove_pod(make_pod(record.name, uid=uid, node=record.node))
        else:
            left, right = (core.schedule_one(make_info(f"p{step}")) for core in cores)
            assert (left.node, left.total, left.message) == (right.node, right.total, right.message)
