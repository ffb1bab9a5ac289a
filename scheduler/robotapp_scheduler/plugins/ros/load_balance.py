"""LoadBalanceScore: prefer nodes with little taken, weighted by what the pod's class needs most."""

from typing import Annotated, Final

import msgspec
import numpy as np

from robotapp_scheduler.core.cache.snapshot import LoadField, Snapshot
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.argument_words import check_word, one_of
from robotapp_scheduler.core.framework.interface import ScoreResult
from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.pods.pod_info import PodInfo

WEIGHTS: Final = {"realtime": (0.65, 0.25, 0.10), "best_effort": (0.35, 0.35, 0.30)}
"""cpu, memory, gpu per QoS class; all others use DEFAULT."""
DEFAULT: Final = (0.50, 0.30, 0.20)

SOURCES: Final = ("Requests", "Telemetry")


class LoadBalanceArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """source: Requests counts what pods request, Telemetry what agents measure (requests where they do not)."""

    source: Annotated[str, one_of(SOURCES)] = "Requests"


class LoadBalanceScore:
    """100·(1 - Σ weight·used share); a node without GPU leaves that column out and the other weights grow."""

    name = "LoadBalanceScore"
    reads = ("ros.qos",)
    node_reads = ("allocatable", "requested", "load")
    row_local = True
    events = Change.NONE
    Args = LoadBalanceArgs

    def __init__(self, args: LoadBalanceArgs | None = None) -> None:
        source = (args or LoadBalanceArgs()).source
        check_word("source", source, SOURCES)
        self._measured = source == "Telemetry"
        if not self._measured:
            self.score_row = self._score_row

    def points_per_share(self, pod: PodInfo) -> tuple[float, float]:
        """What the whole cpu and the whole memory of a node are worth, for the joint planner (core.cycle.joint_problem.ScoresLoad)."""
        cpu, memory, _ = WEIGHTS.get(pod.ros.qos_class if pod.ros is not None else "", DEFAULT)
        return 100.0 * cpu, 100.0 * memory

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """0…100 per node; Skip for a pod without ROS fields."""
        if pod.ros is None:
            return None
        gpus = [name for name in nodes.cluster.nodes.resources.names if name.endswith("/gpu")]
        taken = np.zeros(nodes.n)
        weight_sum = np.zeros(nodes.n)
        columns: tuple[tuple[tuple[str, ...], LoadField], ...] = (
            (("cpu",), "cpu_percent"),
            (("memory",), "memory_percent"),
            (tuple(gpus), "gpu_percent"),
        )
        for weight, (resources, field) in zip(WEIGHTS.get(pod.ros.qos_class, DEFAULT), columns, strict=True):
            share = self._share(nodes, resources, field)
            there = ~np.isnan(share)
            taken += np.where(there, weight * share, 0.0)
            weight_sum += np.where(there, weight, 0.0)
        used = np.where(weight_sum > 0.0, taken / np.maximum(weight_sum, 1e-9), 0.0)
        # Rounded first: 100·(1 - 0.29) is 70.99999… in floats and must not be cut to 70.
        return np.clip(np.round(100.0 * (1.0 - used), 6), 0.0, 100.0)

    def _score_row(self, pod: PodInfo, row: Row) -> int:
        """The score of one node, from requests."""
        ros = pod.ros
        if ros is None:
            return 0
        gpus = tuple(name for name in row.resources if name.endswith("/gpu"))
        taken = weight_sum = 0.0
        for weight, names in zip(WEIGHTS.get(ros.qos_class, DEFAULT), (("cpu",), ("memory",), gpus), strict=True):
            there = row.of(names)
            offered = sum(allocatable for allocatable, _, _ in there)
            if offered > 0:
                taken += weight * (sum(requested for _, requested, _ in there) / offered)
                weight_sum += weight
        used = taken / weight_sum if weight_sum > 0.0 else 0.0
        return int(min(max(float(np.round(100.0 * (1.0 - used), 6)), 0.0), 100.0))

    def _share(self, nodes: Snapshot, resources: tuple[str, ...], field: LoadField) -> FloatArray:
        """Used share per node, NaN where the node offers none."""
        offered = np.zeros(nodes.n)
        used = np.zeros(nodes.n)
        for resource in resources:
            offered += nodes.allocatable(resource)
            used += nodes.requested(resource)
        share = np.where(offered > 0.0, used / np.maximum(offered, 1.0), np.nan)
        if not self._measured:
            return share
        measured = nodes.load(field) / 100.0
        return np.where(np.isnan(measured) | np.isnan(share), share, measured)
