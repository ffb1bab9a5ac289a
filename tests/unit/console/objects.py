"""Objects as the API server sends them, and snapshots of decoded ones."""

import time
from datetime import UTC, datetime
from typing import Any

import msgspec

from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_claims.rules.objects import Claim, ResourceClaim, ResourceSlice
from robotapp_console.views.objects import App, Instance, Node, Pod, Pool, Telemetry
from robotapp_console.views.snapshot import Refusal, Snapshot

Object = dict[str, Any]
NOW_S = 1_800_000_000.0


def timestamp(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def node(
    name: str,
    *,
    robot: str = "",
    zone: str = "",
    tier: str = "",
    ready: str = "True",
    labels: dict[str, str] | None = None,
    annotations: dict[str, str] | None = None,
    unschedulable: bool = False,
) -> Object:
    known = {"robotics.io/robot": robot, "topology.kubernetes.io/zone": zone, "robotics.io/tier": tier}
    return {
        "metadata": {
            "name": name,
            "labels": {key: value for key, value in known.items() if value} | (labels or {}),
            "annotations": annotations or {},
        },
        "spec": {"unschedulable": unschedulable},
        "status": {
            "allocatable": {"cpu": "4", "memory": "8Gi"},
            "conditions": [{"type": "Ready", "status": ready, "lastTransitionTime": timestamp(NOW_S - 300)}],
        },
    }


def app(
    name: str,
    *,
    namespace: str = "default",
    uid: str = "",
    phase: str = "Running",
    troubled: list[Object] | None = None,
) -> Object:
    conditions = [
        {"type": kind, "status": "True", "reason": "Fine", "message": "", "lastTransitionTime": timestamp(NOW_S - 60)}
        for kind in ("Ready", "Accepted", "Placed")
    ]
    return {
        "metadata": {"name": name, "namespace": namespace, "uid": uid or f"u-{name}", "generation": 1},
        "spec": {},
        "status": {
            "phase": phase,
            "observedGeneration": 1,
            "conditions": conditions,
            "troubled": troubled or [],
            "summary": {"ready": "1/1", "domain": "7"},
        },
    }


def instance(
    app_name: str,
    robot: str = "",
    *,
    namespace: str = "default",
    app_uid: str = "",
    phase: str = "Running",
    components: list[Object] | None = None,
    edges: list[Object] | None = None,
) -> Object:
    return {
        "metadata": {"name": f"{app_name}-{robot or 'x'}", "namespace": namespace},
        "spec": {"app": app_name, "appUID": app_uid or f"u-{app_name}", "instance": robot, "robot": robot},
        "status": {"phase": phase, "components": components or [], "edges": edges or [], "domain": 7},
    }


def telemetry(
    name: str,
    *,
    rtt: dict[str, float] | None = None,
    devices: list[Object] | None = None,
    written_s: float | None = None,
    **status: Any,
) -> Object:
    entries = [{"peer": peer, "p95Us": int(ms * 1000)} for peer, ms in (rtt or {}).items()]
    written = timestamp(time.time() if written_s is None else written_s)
    return {
        "metadata": {"name": name, "managedFields": [{"time": written, "subresource": "status"}]},
        "status": {"intervalSeconds": 10, "seq": 5, "rtt": entries, "devices": devices or [], **status},
    }


def device_claim(device: str, *, node: str = "amr-07", holder: str = "teleop", component: str = "driver") -> Object:
    return {
        "metadata": {"name": f"dev.n0123456789.{device}"},
        "spec": {
            "device": {"node": node, "type": "can", "id": device},
            "holder": {
                "apiVersion": "robotics.io/v1alpha1",
                "kind": "RobotApp",
                "namespace": "default",
                "name": holder,
                "uid": "u",
                "component": component,
            },
        },
        "status": {"phase": "Reserved"},
    }


def resource_claim(
    device: str, *, node: str = "amr-07", namespace: str = "default", holder: str = "teleop", component: str = "driver"
) -> Object:
    """A claim of an app's component whose device the driver hands over."""
    owner = {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "name": holder,
        "uid": f"u-{holder}",
        "controller": True,
    }
    result = {"request": "d", "driver": "devices.robotics.io", "pool": node, "device": device}
    return {
        "metadata": {
            "name": f"{holder}-{component}",
            "namespace": namespace,
            "uid": f"u-{namespace}-{holder}-{component}",
            "labels": {"robotics.io/component": component},
            "ownerReferences": [owner],
        },
        "status": {"allocation": {"devices": {"results": [result]}}},
    }


def resource_slice(node: str = "amr-07") -> Object:
    """A slice of our driver: it runs on the node."""
    return {"metadata": {"name": f"{node}-slice"}, "spec": {"driver": "devices.robotics.io", "nodeName": node}}


def pool(name: str = "default", used: str = "12/119", quarantined: int = 0) -> Object:
    return {"metadata": {"name": name}, "status": {"used": used, "quarantined": quarantined}}


def pod(name: str, node: str, *, cpu: str = "1", memory: str = "1Gi", phase: str = "Running") -> Object:
    resources = {"requests": {"cpu": cpu, "memory": memory}}
    return {
        "metadata": {"name": name, "namespace": "default"},
        "spec": {"nodeName": node, "containers": [{"name": "main", "resources": resources}]},
        "status": {"phase": phase},
    }


def snapshot(
    *,
    apps: list[Object] = [],  # noqa: B006 - never changed
    instances: list[Object] = [],  # noqa: B006
    nodes: list[Object] = [],  # noqa: B006
    reports: list[Object] = [],  # noqa: B006
    claims: list[Object] = [],  # noqa: B006
    resource_claims: list[Object] = [],  # noqa: B006
    slices: list[Object] = [],  # noqa: B006
    pools: list[Object] = [],  # noqa: B006
    pods: list[Object] = [],  # noqa: B006
    refused: tuple[str, ...] = (),
    now_s: float = NOW_S,
) -> Snapshot:
    """All of them decoded as the informers do. Telemetry without a time was written just now."""
    decoded = {item.metadata.name: item for item in map(_reader(Telemetry), reports)}
    trips = RoundTrips()
    for name, report in decoded.items():
        trips.receive(name, report.status.rtt, seq=5, interval_s=10, now_s=_seconds(report.written_at))
    trips.expire(now_s)
    return Snapshot(
        apps={_key(item): item for item in map(_reader(App), apps)},
        instances={_key(item): item for item in map(_reader(Instance), instances)},
        nodes={item.name: item for item in map(_reader(Node), nodes)},
        telemetry=decoded,
        claims={item.name: item for item in map(_reader(Claim), claims)},
        resource_claims={_key(item): item for item in map(_reader(ResourceClaim), resource_claims)},
        slices={item.metadata.name: item for item in map(_reader(ResourceSlice), slices)},
        pools={item.metadata.name: item for item in map(_reader(Pool), pools)},
        pods={_key(item): item for item in map(_reader(Pod), pods)},
        round_trips=trips,
        refusals={plural: Refusal(plural, "forbidden", "ask") for plural in refused},
        now_s=now_s,
    )


def _reader(kind: Any) -> Any:
    return lambda obj: msgspec.convert(obj, kind)


def _key(item: Any) -> str:
    return f"{item.metadata.namespace}/{item.metadata.name}"


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()
