"""Instances and pods of a RobotApp, as they are now."""

from collections.abc import Mapping
from typing import Any

from rigel_bridge.cluster.kubectl import Kubectl
from rigel_bridge.names import APP_LABEL, APP_UID_LABEL, INSTANCES


def instances_of(kubectl: Kubectl, app: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The instances of the living app, by name."""
    metadata = app["metadata"]
    items = kubectl.items("get", INSTANCES, "-l", f"{APP_LABEL}={metadata['name']}")
    own = [item for item in items if item["spec"].get("appUID") == metadata["uid"]]
    return sorted(own, key=lambda item: str(item["metadata"]["name"]))


def pods_of(kubectl: Kubectl, app: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The app's pods, by name."""
    items = kubectl.items("get", "pods", "-l", f"{APP_UID_LABEL}={app['metadata']['uid']}")
    return sorted(items, key=lambda item: str(item["metadata"]["name"]))


def is_ready(pod: Mapping[str, Any]) -> bool:
    conditions = pod.get("status", {}).get("conditions", ())
    return any(each["type"] == "Ready" and each["status"] == "True" for each in conditions)
