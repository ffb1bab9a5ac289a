"""Nodes, pods and apps for tests of the scheduler's core: JSON in, the product's structs out."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from robotapp_api.model.names import API_VERSION, SCHEDULER_NAME, THESIS_SCHEDULER_NAME, Label
from robotapp_claims.rules.objects import Claim
from robotapp_scheduler.core.api.core_v1 import Node, Owned, Pod
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry, RobotApp
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import Profile, ProfileSpec, build_profiles
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.pod_signature import PodSignatures
from robotapp_scheduler.plugins.registry import catalogue

Json = dict[str, Any]


class Clock:
    """Time that only moves when told."""

    def __init__(self, now_s: float = 1000.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s

    def forward(self, seconds: float) -> None:
        self.now_s += seconds


def default_profiles(specs: Iterable[ProfileSpec] | None = None) -> dict[str, Profile]:
    """With the built-in plugins; without specs those of both names that are served when there is no configuration."""
    chosen = specs if specs is not None else (ProfileSpec(SCHEDULER_NAME), ProfileSpec(THESIS_SCHEDULER_NAME))
    return build_profiles(chosen, catalogue())


def node_json(name: str, *, labels: Mapping[str, str] | None = None, cpu: str = "4", memory: str = "8Gi",
              pods: str = "110", taints: list[Json] | None = None, unschedulable: bool = False,
              annotations: Mapping[str, str] | None = None, **extended: str) -> Json:  # fmt: skip
    return {
        "metadata": {
            "name": name,
            "labels": {"kubernetes.io/hostname": name, **(labels or {})},
            "annotations": dict(annotations or {}),
        },
        "spec": {"unschedulable": unschedulable, "taints": taints or []},
        "status": {"allocatable": {"cpu": cpu, "memory": memory, "pods": pods, **extended}},
    }


def pod_json(name: str = "p", *, uid: str = "", cpu: str | None = "100m", memory: str | None = "128Mi",
             node: str = "", priority: int = 0, labels: Mapping[str, str] | None = None,
             annotations: Mapping[str, str] | None = None, scheduler: str = SCHEDULER_NAME,
             owner: Json | None = None, namespace: str = "default", **spec: Any) -> Json:  # fmt: skip
    requests = {key: value for key, value in (("cpu", cpu), ("memory", memory)) if value is not None}
    body = {"containers": [{"name": "main", "resources": {"requests": requests}}], "schedulerName": scheduler}
    meta: Json = {"name": name, "namespace": namespace, "uid": uid or f"uid-{name}"}
    meta["labels"], meta["annotations"] = dict(labels or {}), dict(annotations or {})
    if owner is not None:
        meta["ownerReferences"] = [owner]
    return {"metadata": meta, "spec": {**body, "nodeName": node, "priority": priority, **spec}, "status": {}}


def to_node(raw: Json) -> Node:
    return msgspec.convert(raw, Node)


def to_pod(raw: Json) -> Pod:
    return msgspec.convert(raw, Pod)


def make_node(name: str, **fields: Any) -> Node:
    return to_node(node_json(name, **fields))


def make_pod(name: str = "p", **fields: Any) -> Pod:
    return to_pod(pod_json(name, **fields))


_SIGNATURES: Final = PodSignatures()
"""Replicas share what they have in common, as those of one cache do."""


def make_info(name: str = "p", **fields: Any) -> PodInfo:
    pod = make_pod(name, **fields)
    return PodInfo(pod, _SIGNATURES.of(pod))


def make_cluster(*nodes: Node, clock: Clock | None = None) -> Cache:
    cluster = Cache(clock=clock or Clock())
    for node in nodes:
        cluster.apply_node(node)
    return cluster


def make_core(*nodes: Node, clock: Clock | None = None, args: Mapping[str, Json] | None = None) -> SchedulerCore:
    """A core with our profile; `args` are plugin arguments by plugin name."""
    clock = clock or Clock()
    cluster = make_cluster(*nodes, clock=clock)
    profiles = default_profiles([ProfileSpec(SCHEDULER_NAME, plugin_config=args or {})])
    return SchedulerCore(cluster, profiles, clock=clock)


def app_object(*components: Json, name: str = "teleop", uid: str = "app-1", generation: int = 1,
               observed: int | None = None, edges: list[Json] | None = None, **spec: Any) -> RobotApp:  # fmt: skip
    raw = {
        "metadata": {"name": name, "namespace": "default", "uid": uid, "generation": generation},
        "spec": {"components": list(components), "edges": edges or [], **spec},
        "status": {"observedGeneration": generation if observed is None else observed},
    }
    return msgspec.convert(raw, RobotApp)


def owner(kind: str, name: str, uid: str) -> Json:
    return {"kind": kind, "name": name, "uid": uid, "controller": True}


def chain(component: str, *, app: str = "teleop", app_uid: str = "app-1", suffix: str = "") -> tuple[Owned, Owned]:
    """Deployment and ReplicaSet of one component."""
    deployment = f"{app}-{component}{suffix}"
    ours = {"namespace": "default", "labels": {str(Label.APP_UID): app_uid}}
    meta = {**ours, "name": deployment, "uid": f"d-{deployment}"}
    replica_set = {**ours, "name": f"{deployment}-abc", "uid": f"r-{deployment}"}
    return (
        msgspec.convert({"metadata": {**meta, "ownerReferences": [owner("RobotApp", app, app_uid)]}}, Owned),
        msgspec.convert(
            {"metadata": {**replica_set, "ownerReferences": [owner("Deployment", deployment, meta["uid"])]}}, Owned
        ),
    )


def member_pod(component: str, *, app: str = "teleop", app_uid: str = "app-1", instance: str = "", uid: str = "",
               suffix: str = "", **fields: Any) -> Pod:  # fmt: skip
    """A pod of an app's component, owned through `chain(component)`."""
    deployment = f"{app}-{component}{suffix}"
    labels = {Label.APP: app, Label.APP_UID: app_uid, Label.COMPONENT: component, Label.INSTANCE: instance}
    labels = {str(key): value for key, value in labels.items()}
    name = fields.pop("name", f"{deployment}-abc-{uid or component}")
    return make_pod(
        name,
        uid=uid or f"uid-{deployment}",
        labels={**labels, **fields.pop("labels", {})},
        owner=owner("ReplicaSet", f"{deployment}-abc", f"r-{deployment}"),
        **fields,
    )


def telemetry(node: str, *, rtt_ms: Mapping[str, float] | None = None, p95_ms: Mapping[str, float] | None = None,
              lost: Sequence[str] = (), devices: list[Json] | None = None, interval_s: int = 10,
              load: Json | None = None, seq: int | None = None) -> NodeTelemetry:  # fmt: skip
    """RTT in milliseconds; p95 equals p50 unless given. `lost`: peers that answered no probe.

    Without the number of its round (`seq`) a report is another one as soon as a time differs.
    """
    entries: list[Json] = [
        {"peer": peer, "p50Us": round(ms * 1000), "p95Us": round((p95_ms or {}).get(peer, ms) * 1000)}
        for peer, ms in (rtt_ms or {}).items()
    ]
    entries += [{"peer": peer, "lossPPM": 1_000_000} for peer in lost]
    status = {"intervalSeconds": interval_s, "rtt": entries, "devices": devices or [], "load": load, "seq": seq}
    return msgspec.convert({"metadata": {"name": node}, "status": status}, NodeTelemetry)


def device_claim(node: str, device: str, *, uid: str, instance: str = "", component: str = "", phase: str = "Bound",
                 pod: str = "", holder_name: str = "other") -> Claim:  # fmt: skip
    holder = {"apiVersion": API_VERSION, "kind": "RobotApp", "namespace": "default", "name": holder_name,
              "uid": uid, "instance": instance, "component": component}  # fmt: skip
    spec = {"device": {"node": node, "id": device, "type": device.split("-", maxsplit=1)[0]}, "holder": holder}
    raw = {"metadata": {"name": f"dev.{node}.{device}"}, "spec": spec, "status": {"phase": phase, "pod": pod}}
    return msgspec.convert(raw, Claim)
