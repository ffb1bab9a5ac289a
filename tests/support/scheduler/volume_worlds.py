"""Nodes and storage objects in a scheduler's core, and what it answers node by node."""

from typing import Any

from tests.support.scheduling import make_core, make_node

from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.pods.pod_info import PodInfo

Json = dict[str, Any]


def world(*objects: Any, nodes: int = 3, zones: str = "abc", args: Json | None = None) -> SchedulerCore:
    """Nodes n0, n1, … in zones a, b, …, and storage objects."""
    core = make_core(*(make_node(f"n{i}", labels={"zone": zones[i]}) for i in range(nodes)), args=args)
    store = core.cluster.volumes
    apply = {
        "Claim": store.apply_claim,
        "PersistentVolume": store.apply_volume,
        "StorageClass": store.apply_class,
        "CSINode": store.apply_csi_node,
        "CSIDriver": store.apply_driver,
        "CSIStorageCapacity": store.apply_capacity,
        "VolumeAttachment": store.apply_attachment,
    }
    for each in objects:
        apply[type(each).__name__](each)
    return core


def decide(core: SchedulerCore, pod: PodInfo) -> ScheduleResult:
    return core.schedule_one(pod, assume=False)


def refusals(core: SchedulerCore, pod: PodInfo) -> list[tuple[str, ...]]:
    """Reasons per node n0, n1, …"""
    assert core.prepare(pod) is None
    evaluation = core.runner(SCHEDULER_NAME).evaluate(pod, None)
    return [evaluation.reasons.values[code].texts for code in evaluation.reason]


def scores(core: SchedulerCore, pod: PodInfo) -> list[int]:
    """VolumeBinding's score per node."""
    assert core.prepare(pod) is None
    engine = core.runner(SCHEDULER_NAME)
    evaluation = engine.evaluate(pod, None)
    engine.score(pod, evaluation)
    (column,) = [column for column in evaluation.scores if column.plugin.name == "VolumeBinding"]
    positions = (evaluation.reason == 0).nonzero()[0]
    return [] if column.skipped else evaluation.score_of(column, positions)
