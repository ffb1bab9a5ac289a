"""The pod annotations of the thesis: what a component requests of the scheduler, as JSON. The inverse of `scheduling`."""

import json
from collections.abc import Mapping
from typing import Any, Final

from rigel_bridge.names import SCHEDULER_PREFIX

_POLICIES: Final = {
    "latencyBudget": "latency_budget",
    "reliability": "reliability",
    "durability": "durability",
    "liveliness": "liveliness",
    "deadline": "deadline",
    "queueSize": "queue_size",
    "tcpNodelay": "tcp_nodelay",
}


def pod_annotations(spec: Mapping[str, Any], component: Mapping[str, Any], *, app: str) -> dict[str, str]:
    """Annotations by name, without those that would be empty. Pods of the same app are named by their Deployment."""
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
