"""A RobotApp as plain Kubernetes objects, for clusters without the operator.

`pods`: Deployments whose pods carry the thesis' annotations, for our scheduler alone. `manifests`: Deployments for any
scheduler. Both bring the volume claims and, for ROS 1, the master. What only the operator can do is noted.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from rigel_bridge.document.distros import ros_version
from rigel_bridge.document.failures import BridgeError, Place
from rigel_bridge.names import BRIDGE_APP_LABEL, DEFAULT_SCHEDULER, GRANTED_DOMAIN, SCHEDULER, SCHEDULER_PREFIX
from rigel_bridge.render.app import Rendered
from rigel_bridge.render.draft import Path, written

FORMATS: Final = ("robotapp", "pods", "manifests")
_PORT: Final = 11311
_DEPLOYMENT: Final = ("apps/v1", "Deployment")
_COMPONENT_LABEL: Final = "app.kubernetes.io/component"
_CONTAINER: Final = (
    *("name", "image", "command", "args", "workingDir", "env", "envFrom", "ports", "volumeMounts", "resources"),
    *("imagePullPolicy", "securityContext", "livenessProbe", "readinessProbe", "startupProbe", "lifecycle"),
)
_SCHEDULING: Final = ("qosClass", "policies", "devices", "requires", "sharedData")
_POLICIES: Final = {
    "latencyBudget": "latency_budget",
    "reliability": "reliability",
    "durability": "durability",
    "liveliness": "liveliness",
    "deadline": "deadline",
    "queueSize": "queue_size",
    "tcpNodelay": "tcp_nodelay",
}
"""Words of the annotation by field."""
_ROS2: Final = ("domain", "allowUnsafeDomain", "rmw")
_HARDWARE: Final = ("name", "type", "model", "interface")
"""Of an entry of `devices`, as the annotation has it; the name is for the grants alone."""
_PLACEMENT: Final = ("zones", "masterNode")


def workloads(rendered: Rendered, *, annotated: bool) -> tuple[tuple[dict[str, Any], ...], tuple[str, ...]]:
    """Objects in the order in which they are applied, and what is to be noted of them. `annotated`: for our scheduler, else for any."""
    app, spec = rendered.app, rendered.app["spec"]
    # Pods that another scheduler places carry no ROS annotations, as in the thesis' benchmark of kube-scheduler's own.
    ours = annotated and spec.get("schedulerName") != DEFAULT_SCHEDULER
    found: list[dict[str, Any]] = [*rendered.claims, *_master(app)]
    found += [_deployment(rendered, component, ours=ours) for component in spec["components"]]
    return tuple(found), (*rendered.plain_notes, *_notes(rendered, ours=ours))


def _deployment(rendered: Rendered, component: Mapping[str, Any], *, ours: bool) -> dict[str, Any]:
    app, spec = rendered.app, rendered.app["spec"]
    metadata = app["metadata"]
    labels = {BRIDGE_APP_LABEL: metadata["name"], _COMPONENT_LABEL: component["name"]}
    template = component.get("template", {})
    annotations = dict(template.get("metadata", {}).get("annotations", {}))
    if ours:
        annotations |= pod_annotations(spec, component, app=metadata["name"])
    if ours and _allocated(spec):
        annotations[f"{SCHEDULER_PREFIX}dds-domain"] = str(spec.get("ros2", {}).get("domain", "auto"))
    pod: dict[str, Any] = {"containers": [_container(app, component, ours=ours)], **template.get("spec", {})}
    scheduler = _scheduler(spec, annotations, ours=ours)
    if scheduler:
        pod["schedulerName"] = scheduler
    inner: dict[str, Any] = {"labels": {**template.get("metadata", {}).get("labels", {}), **labels}}
    if annotations:
        inner["annotations"] = annotations
    body: dict[str, Any] = {"replicas": component.get("replicas", 1), "selector": {"matchLabels": labels}}
    if strategy := rendered.strategy or _strategy(component):
        body["strategy"] = strategy
    body["template"] = {"metadata": inner, "spec": pod}
    return _object(app, f"{metadata['name']}-{component['name']}", _DEPLOYMENT, body, labels)


def _strategy(component: Mapping[str, Any]) -> dict[str, str]:
    """One pod is replaced when it is gone, as the operator does it: one publisher at any time."""
    return {"type": "Recreate"} if component.get("replicas", 1) == 1 else {}


def _scheduler(spec: Mapping[str, Any], annotations: Mapping[str, str], *, ours: bool) -> str:
    if ours:
        annotated = any(key.startswith(SCHEDULER_PREFIX) for key in annotations)
        return str(spec.get("schedulerName") or (SCHEDULER if annotated else ""))
    return DEFAULT_SCHEDULER if spec.get("schedulerName") == DEFAULT_SCHEDULER else ""


def _allocated(spec: Mapping[str, Any]) -> bool:
    """Whether the scheduler grants the domain: to one pod, which then has it for itself."""
    return ros_version(spec) == 2 and _pods(spec) == 1


def _pods(spec: Mapping[str, Any]) -> int:
    return sum(component.get("replicas", 1) for component in spec["components"])


def _container(app: Mapping[str, Any], component: Mapping[str, Any], *, ours: bool) -> dict[str, Any]:
    found = {key: component[key] for key in _CONTAINER if key in component}
    own = component.get("env", [])
    written = {entry["name"] for entry in own}
    found["env"] = [*own, *(entry for entry in _environment(app, ours=ours) if entry["name"] not in written)]
    return found


def _environment(app: Mapping[str, Any], *, ours: bool) -> list[dict[str, Any]]:
    spec = app["spec"]
    if ros_version(spec) == 1:
        uri = spec.get("ros1", {}).get("uri") or f"http://{_master_name(app)}:{_PORT}"
        address = {"fieldRef": {"fieldPath": "status.podIP"}}
        return [{"name": "ROS_MASTER_URI", "value": uri}, {"name": "ROS_IP", "valueFrom": address}]
    ros2 = spec.get("ros2", {})
    domain: dict[str, Any] = {"name": "ROS_DOMAIN_ID", "value": str(ros2.get("domain", 0))}
    if ours and _allocated(spec):
        granted = {"fieldRef": {"fieldPath": f"metadata.annotations['{GRANTED_DOMAIN}']"}}
        domain = {"name": "ROS_DOMAIN_ID", "valueFrom": granted}
    found = [domain]
    if ros2.get("rmw"):
        found.append({"name": "RMW_IMPLEMENTATION", "value": ros2["rmw"]})
    return found


def _master(app: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Deployment and Service of the app's own master; nothing for ROS 2 and for an external one."""
    spec = app["spec"]
    ros1 = spec.get("ros1", {})
    if ros_version(spec) == 2 or ros1.get("master") == "External":
        return []
    name = _master_name(app)
    labels = {BRIDGE_APP_LABEL: app["metadata"]["name"], _COMPONENT_LABEL: "ros-master"}
    container = {
        "name": "ros-master",
        "image": ros1.get("image") or f"ros:{spec['ros']['distro']}-ros-core",
        "args": ["roscore"],
        "env": [{"name": "ROS_HOSTNAME", "value": name}, {"name": "ROS_MASTER_URI", "value": f"http://{name}:{_PORT}"}],
        "ports": [{"name": "master", "containerPort": _PORT}],
        "readinessProbe": {"tcpSocket": {"port": _PORT}},
    }
    body = {
        "replicas": 1,
        "selector": {"matchLabels": labels},
        "strategy": {"type": "Recreate"},
        "template": {"metadata": {"labels": labels}, "spec": {"containers": [container]}},
    }
    ports = {"selector": labels, "ports": [{"name": "master", "port": _PORT, "targetPort": _PORT}]}
    return [
        _object(app, name, ("v1", "Service"), ports, labels),
        _object(app, name, _DEPLOYMENT, body, labels),
    ]


def _master_name(app: Mapping[str, Any]) -> str:
    return f"{app['metadata']['name']}-ros-master"


def _object(
    app: Mapping[str, Any], name: str, kind: tuple[str, str], spec: dict[str, Any], labels: dict[str, str]
) -> dict[str, Any]:
    """`kind` with its version: ("v1", "Service")."""
    if len(name) > 63:
        raise BridgeError(Place("RobotApp"), f"{kind[1]} {name} has a name of more than 63 characters: shorten --name")
    metadata: dict[str, Any] = {"name": name}
    if "namespace" in app["metadata"]:
        metadata["namespace"] = app["metadata"]["namespace"]
    metadata["labels"] = dict(labels)
    if annotations := app["metadata"].get("annotations"):
        metadata["annotations"] = dict(annotations)
    return {"apiVersion": kind[0], "kind": kind[1], "metadata": metadata, "spec": spec}


def _lost(spec: Mapping[str, Any], *, ours: bool) -> Iterator[Path]:
    """The fields that plain objects have no place for: all but those that are carried over, so also those of a later API."""
    kept: dict[str, tuple[str, ...] | None] = {
        "ros": None,
        "ros1": None,
        "schedulerName": None,
        "components": None,
        "ros2": _ROS2,
    }
    if ours:
        kept["placement"] = _PLACEMENT
    for field, value in spec.items():
        if field not in kept:
            yield (field,)
        elif (inner := kept[field]) is not None:
            yield from ((field, each) for each in value if each not in inner)
    carried = (*_CONTAINER, "template", "replicas", *(_SCHEDULING if ours else ()))
    for index, component in enumerate(spec["components"]):
        yield from (("components", index, field) for field in component if field not in carried)
        for number, device in enumerate(component.get("devices", ()) if ours else ()):
            yield from (("components", index, "devices", number, each) for each in device if each not in _HARDWARE)


def _notes(rendered: Rendered, *, ours: bool) -> list[str]:
    spec = rendered.app["spec"]
    notes = [
        f"{rendered.origin(path)}: {written(path)} needs the operator and its scheduler; plain objects have no place for it"
        for path in _lost(spec, ours=ours)
    ]
    alone = ours and _allocated(spec)
    if ros_version(spec) == 2 and not alone and "domain" not in spec.get("ros2", {}):
        notes.append(
            f"{rendered.origin(('ros',))}: ROS_DOMAIN_ID is 0, which every laptop uses: write dds_domain, or render a "
            "RobotApp, which gets its own"
        )
    return notes


def pod_annotations(spec: Mapping[str, Any], component: Mapping[str, Any], *, app: str) -> dict[str, str]:
    """What a component requests of the scheduler, as the thesis writes it: the inverse of `scheduling`.

    Annotations by name, without those that would be empty. Pods of the same app are named by their Deployment.
    """
    found = {
        "policies": _policies(component),
        "topology": _topology(spec.get("placement", {})),
        "affinity": _affinity(component),
        "shared-data": _shared(component.get("sharedData", {}), app),
    }
    return {f"{SCHEDULER_PREFIX}{key}": json.dumps(value) for key, value in found.items() if value}


def _policies(component: Mapping[str, Any]) -> dict[str, Any]:
    written = component.get("policies", {})
    found = {word: written[field] for field, word in _POLICIES.items() if field in written}
    if "qosClass" in component:
        found["qos_class"] = component["qosClass"]
    return found


def _topology(placement: Mapping[str, Any]) -> dict[str, Any]:
    words = {"masterNode": "master_node", "zones": "preferred_zones"}
    return {word: placement[field] for field, word in words.items() if placement.get(field)}


def _affinity(component: Mapping[str, Any]) -> dict[str, Any]:
    hardware = [
        {key: entry[key] for key in ("type", "model", "interface") if entry.get(key)}
        for entry in (*component.get("devices", ()), *component.get("requires", ()))
    ]
    return {"hardware_requirements": hardware} if hardware else {}


def _shared(shared: Mapping[str, Any], app: str) -> dict[str, Any]:
    peers = [*(f"{app}-{name}" for name in shared.get("with", ())), *shared.get("peerPods", ())]
    found = {"peer_pods": peers, "pvc": shared.get("claimNames", [])}
    return {key: value for key, value in found.items() if value}
