"""RobotApps, nodes and children as the operator's plan sees them, with just enough in them."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
from tests.support.apiobjects import ROS

from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.names import API_VERSION, Label
from robotapp_api.values.placement.round_trips import RoundTrips
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.diff.diff import Change, Observed, Plan, ref_of
from robotapp_operator.plan.render.child import DEPLOYMENT
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Node, Pod, Service, Telemetry
from robotapp_operator.watch.cache import Cache

UID = "uid-1"
VERSION = "1.2.0"


def component(name: str = "driver", **fields: Any) -> dict[str, Any]:
    return {"name": name, "image": f"reg/{name}:1", **fields}


def make_app(*components: dict[str, Any], name: str = "teleop", uid: str = UID, **spec: Any) -> App:
    """An App in namespace default; components default to operator and driver."""
    annotations = spec.pop("annotations", {})
    generation = spec.pop("generation", 1)
    body = {"ros": ROS, "components": list(components) or [component("operator"), component("driver")], **spec}
    return App(
        name=name,
        namespace="default",
        uid=uid,
        generation=generation,
        spec=RobotAppSpec.model_validate(body),
        annotations=annotations,
    )


def app_body(app_name: str = "teleop", *, uid: str = UID, generation: int = 1, **spec: Any) -> dict[str, Any]:
    """A RobotApp as the API server sends it."""
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {
            "name": app_name,
            "namespace": "default",
            "uid": uid,
            "generation": generation,
            "resourceVersion": "10",
        },
        "spec": {"ros": ROS, "components": [component("operator"), component("driver")], **spec},
    }


def make_node(
    name: str, *, ready: bool = True, uid: str = "", annotations: Mapping[str, str] | None = None, **labels: str
) -> Node:
    """Labels by short name: robot=, tier=, zone=."""
    full = {Label[key.upper()].value: value for key, value in labels.items()}
    body = {
        "metadata": {"name": name, "uid": uid, "labels": full, "annotations": dict(annotations or {})},
        "status": {"conditions": [{"type": "Ready", "status": "True" if ready else "False"}]},
    }
    return msgspec.convert(body, Node)


def robots(*names: str) -> dict[str, Node]:
    """One node per robot, named n-<robot>."""
    return {f"n-{name}": make_node(f"n-{name}", robot=name, tier="robot") for name in names}


def telemetry(node: str, seq: int | None = None, /, **p95_ms: float | None) -> Telemetry:
    """Peers as keywords, `_` for `-`: telemetry("edge-1", amr_07=12.5). The median is half of it; None: no probe was answered.

    Without the number of its round (`seq`) a report is another one as soon as a time differs.
    """
    rtt = [
        {"peer": peer.replace("_", "-"), "lossPPM": 1_000_000}
        if value is None
        else {"peer": peer.replace("_", "-"), "p50Us": int(value * 500), "p95Us": int(value * 1000)}
        for peer, value in p95_ms.items()
    ]
    status = {"rtt": rtt} if seq is None else {"seq": seq, "rtt": rtt}
    return msgspec.convert({"metadata": {"name": node}, "status": status}, Telemetry)


def round_trips(reports: Mapping[str, Telemetry]) -> RoundTrips:
    """Of these reports, all received just now."""
    cache = Cache()
    for item in reports.values():
        cache.put_telemetry(item, now_s=0.0)
    return cache.round_trips


def stored(change: Change, app: App, *, version: str = VERSION, generation: int = 1) -> Observed:
    """The object the API server has after `change` was written."""
    body = change.child.body(app, version=version)
    uid = change.over.metadata.uid if change.over else f"uid-of-{change.child.ref.name}"
    body["metadata"] |= {"uid": uid, "resourceVersion": "1", "generation": generation}
    return msgspec.convert(body, Deployment if change.child.ref.kind == DEPLOYMENT else Service)


def after(
    plan: Plan, observed: Mapping[ChildRef, Observed], app: App, *, version: str = VERSION
) -> dict[ChildRef, Observed]:
    """The children once `plan` has been carried out."""
    gone = {ref_of(item) for item in plan.deletes}
    kept = {ref: item for ref, item in observed.items() if ref not in gone}
    return kept | {change.child.ref: stored(change, app, version=version) for change in plan.changes}


def make_deployment(
    name: str = "d", *, uid: str = "d-uid", replicas: int = 1, ready: int = 0, **status: Any
) -> Deployment:
    """A Deployment whose controller is up to date unless `status` says otherwise."""
    body = {
        "metadata": {"name": name, "uid": uid, "generation": 1},
        "spec": {"replicas": replicas},
        "status": {
            "observedGeneration": 1,
            "replicas": replicas,
            "updatedReplicas": replicas,
            "readyReplicas": ready,
            **status,
        },
    }
    return msgspec.convert(body, Deployment)


def make_pod(name: str = "p", *, node: str = "", waiting: tuple[str, str] | None = None, **fields: Any) -> Pod:
    """`waiting`: (reason, message) of its container."""
    status: dict[str, Any] = {"phase": "Running" if node else "Pending", **fields.pop("status", {})}
    if waiting:
        state = {"waiting": {"reason": waiting[0], "message": waiting[1]}}
        status["containerStatuses"] = [{"name": "main", "state": state, **fields.pop("container", {})}]
    meta = {"name": name, "namespace": "default", "uid": f"{name}-uid", **fields.pop("metadata", {})}
    return msgspec.convert({"metadata": meta, "spec": {"nodeName": node, **fields}, "status": status}, Pod)


def domain_claim(
    number: int, *, uid: str = UID, instance: str = "", pool: str = "default", phase: str = "Reserved"
) -> Claim:
    holder = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "namespace": "default",
        "name": "teleop",
        "uid": uid,
        "instance": instance,
    }
    body = {
        "metadata": {"name": f"dds.{pool}.c.{number}"},
        "spec": {"holder": holder, "domain": {"pool": pool, "scope": "Cluster", "id": number}},
        "status": {"phase": phase},
    }
    return msgspec.convert(body, Claim)


def by_name(nodes: Iterable[Node]) -> dict[str, Node]:
    return {node.metadata.name: node for node in nodes}
