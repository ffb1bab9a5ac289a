"""Dashboards keep working: the same things happen to kube-scheduler and to ours, and both count them under the same names."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from campaigns.rigs.stage import Stage, nodes, pod
from campaigns.rigs.storage_live import VOLUMES, claim, claims_path, storage_class, volume
from campaigns.rigs.twin import THEIRS, kube_scheduler, scraped
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.machines.topology import apply
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

WHO = {"theirs": THEIRS, "ours": SCHEDULER_NAME}
EVENTS = {
    "UnscheduledPodAdd", "PopFromBackoffQ", "NodeAdd", "NodeUpdateNodeLabel", "NodeUpdateNodeTaint", "NodeUpdateNodeAllocatable",
    "AssignedPodAdd", "AssignedPodUpdatePodLabel", "AssignedPodDelete", "TargetPodUpdatePodSchedulingGatesEliminated",
    "PersistentVolumeClaimAdd", "storage.k8s.io/StorageClassAdd", "PersistentVolumeAdd",
}  # fmt: skip
FAMILIES = (
    "schedule_attempts", "scheduling_attempt_duration_seconds", "scheduling_algorithm_duration_seconds", "pod_scheduling_attempts",
    "pod_scheduling_sli_duration_seconds", "pending_pods", "queue_incoming_pods", "unschedulable_pods", "cache_size",
    "framework_extension_point_duration_seconds", "plugin_execution_duration_seconds", "preemption_victims", "preemption_attempts",
)  # fmt: skip


@pytest.fixture
def upstream(installed_plane: ControlPlane, tmp_path: Path) -> Iterator[str]:
    """The address of kube-scheduler's metrics."""
    with kube_scheduler(installed_plane, tmp_path) as url:
        yield url


def families(text: str) -> dict[str, tuple[str, set[str], list[float]]]:
    """Type, names of labels and bounds of the buckets of each family."""
    found: dict[str, tuple[str, set[str], list[float]]] = {}
    for family in text_string_to_metric_families(text):
        names = {name for sample in family.samples for name in sample.labels} - {"le"}
        bounds = {float(sample.labels["le"]) for sample in family.samples if "le" in sample.labels}
        found[family.name] = (family.type, names, sorted(bounds))
    return found


def queues(text: str) -> dict[str, float]:
    """Pending pods by queue."""
    return {
        queue: float(n)
        for queue, n in re.findall(r'^scheduler_pending_pods\{queue="(\w+)"\} (\S+)', text, re.MULTILINE)
    }


def counted(text: str) -> set[str]:
    """Events that brought pods into a queue."""
    return set(re.findall(r'^scheduler_queue_incoming_pods_total\{event="([^"]+)"', text, re.MULTILINE))


class Twins:
    """A pod for each of the two schedulers, named alike."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def waiting(self, name: str, *, saying: str = "", **fields: Any) -> None:
        """They find no place yet, for a reason in these words."""
        for suffix, scheduler in WHO.items():
            own = (
                {"volumes": [{"name": "data", "persistentVolumeClaim": {"claimName": f"{name}-{suffix}"}}]}
                if name == "mounts"
                else {}
            )
            self.stage.create_pod(pod(f"{name}-{suffix}", scheduler=scheduler, **fields, **own))
        self.told(name, saying)

    def told(self, name: str, saying: str) -> None:
        """Both know why by now, and neither is still trying: what comes next is what wakes them."""
        for suffix in WHO:
            self.stage.wait_refused(f"{name}-{suffix}", reason="Unschedulable", saying=saying)

    def bound(self, name: str) -> None:
        for suffix in WHO:
            self.stage.wait_bound(f"{name}-{suffix}")


def near(**labels: str) -> dict[str, Any]:
    """An affinity to pods with these labels."""
    term = {"labelSelector": {"matchLabels": labels}, "topologyKey": "kubernetes.io/hostname"}
    return {"podAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}


def what_happens_to_nodes(cp: ControlPlane, twins: Twins, node: str) -> None:
    path = f"/api/v1/nodes/{node}"
    twins.waiting("label", nodeSelector={"audit": "yes"})
    cp.api.patch(path, {"metadata": {"labels": {"audit": "yes"}}})
    twins.bound("label")
    # Labelled with the same write: whoever has not seen it yet binds nothing.
    cp.api.patch(path, {"metadata": {"labels": {"cordoned": "yes"}}, "spec": {"unschedulable": True}})
    twins.waiting("cordon", saying="were unschedulable", nodeSelector={"cordoned": "yes"})
    cp.api.patch(path, {"spec": {"unschedulable": None, "taints": None}})
    twins.bound("cordon")
    twins.waiting("large", requests={"cpu": "3"})
    cp.api.patch(f"{path}/status", {"status": {"allocatable": {"cpu": "8"}, "capacity": {"cpu": "8"}}})
    twins.bound("large")


def what_happens_to_pods(cp: ControlPlane, twins: Twins) -> None:
    stage = twins.stage
    twins.waiting("near", affinity=near(app="friend"))
    stage.create_pod(pod("friend", labels={"app": "friend"}, requests={"cpu": "1900m"}))
    twins.bound("near")
    twins.waiting("renamed", affinity=near(app="other"))
    cp.api.patch(f"{stage.pods_path}/friend", {"metadata": {"labels": {"app": "other"}}})
    twins.bound("renamed")
    twins.waiting("late", requests={"cpu": "900m"})
    stage.delete_pod("friend")
    twins.bound("late")
    for suffix, scheduler in WHO.items():
        stage.create_pod(pod(f"gated-{suffix}", scheduler=scheduler, schedulingGates=[{"name": "example.com/gate"}]))
        cp.api.patch(f"{stage.pods_path}/gated-{suffix}", {"spec": {"schedulingGates": None}})
    twins.bound("gated")


def what_happens_to_volumes(cp: ControlPlane, twins: Twins, node: str) -> None:
    name = f"slow-{twins.stage.namespace}"
    twins.waiting("mounts")
    for suffix in WHO:
        cp.api.create(claims_path(twins.stage.namespace), claim(f"mounts-{suffix}", name))
    twins.told("mounts", "unbound immediate PersistentVolumeClaims")
    with storage_class(cp, name):
        twins.told("mounts", "didn't find available persistent volumes to bind")
        for suffix in WHO:
            cp.api.create(VOLUMES, volume(f"{name}-{suffix}", name, node=node))
        twins.bound("mounts")


def test_families_labels_buckets_and_names_of_events_are_kube_schedulers(
    installed_plane: ControlPlane, scheduler: Process, stage: Stage, upstream: str
) -> None:
    cp, twins = installed_plane, Twins(stage)
    first, second = (f"edge-{stage.namespace}-{number}" for number in (1, 2))
    with nodes(cp, edge(first, cpu="2"), edge(second)):
        cp.api.delete(f"/api/v1/nodes/{second}")
        what_happens_to_nodes(cp, twins, first)
        what_happens_to_pods(cp, twins)
        what_happens_to_volumes(cp, twins, first)
        twins.waiting("elsewhere", nodeSelector={"kubernetes.io/hostname": second})
        apply(cp, [edge(second)])
        twins.bound("elsewhere")
    theirs, ours = scraped(upstream), scraped(scheduler.health_url)
    assert queues(ours).keys() == queues(theirs).keys()
    assert counted(theirs) >= EVENTS
    assert counted(ours) >= EVENTS
    known, mine = families(theirs), families(ours)
    for name in FAMILIES:
        kind, labels, bounds = mine[f"scheduler_{name}"]
        assert kind == known[f"scheduler_{name}"][0], name
        assert bounds == known[f"scheduler_{name}"][2], name
        if labels:  # nothing waits any more: no series
            assert labels == known[f"scheduler_{name}"][1], name
