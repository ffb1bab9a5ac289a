"""Delete a RobotApp and wait until nothing of it is left."""

from collections.abc import Mapping
from typing import Any, Final

from rigel_bridge.cluster import apps, history
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.waiting import Clock
from rigel_bridge.document.failures import Exit
from rigel_bridge.names import APP_LABEL, APP_UID_LABEL, APPS, INSTANCES

_CHILDREN: Final = ("deployments.apps", "replicasets.apps", "pods", "services")


def remove(kubectl: Kubectl, name: str, *, timeout_s: float, clock: Clock) -> bool:
    """Whether there was such an app; when this returns, it and what belonged to it are gone.

    Children go by their owner references; the app's domain and devices come back by the operator's sweep.
    """
    app = apps.read(kubectl, name)
    if app is None:
        return False
    kubectl.run("delete", APPS, name, "--ignore-not-found", "--wait=false")
    left: list[str] = []

    def gone() -> bool:
        left[:] = _left(kubectl, app)
        return not left

    if not clock.until(gone, timeout_s=timeout_s):
        raise ClusterError(
            f"RobotApp {name} is deleted, but after {timeout_s:g} s there still are {', '.join(left[:10])}: "
            "pods on a node that cannot be reached stay until it is back",
            code=Exit.NOT_READY,
        )
    return True


def _left(kubectl: Kubectl, app: Mapping[str, Any]) -> list[str]:
    """Kind and name of what still belongs to the app, the app itself among it. An app made anew under its name is another one."""
    name, uid = app["metadata"]["name"], app["metadata"]["uid"]
    present = apps.read(kubectl, name)
    found = [f"robotapp/{name}"] if present and present["metadata"]["uid"] == uid else []
    for kind in _CHILDREN:
        found += [f"{kind}/{item['metadata']['name']}" for item in _listed(kubectl, kind, f"{APP_UID_LABEL}={uid}")]
    for item in _listed(kubectl, INSTANCES, f"{APP_LABEL}={name}"):
        if item["spec"].get("appUID") == uid:
            found.append(f"{INSTANCES}/{item['metadata']['name']}")
    return found + [f"controllerrevision/{name}" for name in _without_history(kubectl, app)]


def _without_history(kubectl: Kubectl, app: Mapping[str, Any]) -> list[str]:
    """Names of past specs that were still there; they are deleted, which is quicker than the garbage collector."""
    try:
        names = [revision.name for revision in history.read(kubectl, app)]
        history.delete(kubectl, names)
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        return []
    return names


def _listed(kubectl: Kubectl, kind: str, selector: str) -> list[dict[str, Any]]:
    """Objects of a kind; none where the user may not list them."""
    try:
        items: list[dict[str, Any]] = kubectl.items("get", kind, "-l", selector)
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        return []
    return items
