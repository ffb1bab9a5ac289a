"""What becomes of the pods of a lost node: which stay, which end, and which get a successor that needs another node."""

from typing import Final

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.toleration import tolerates
from robotapp_scheduler.core.api.core_v1 import Node, Pod, Taint, controller_of
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.group_gates import fails_over
from robotapp_scheduler.core.pods.pod_info import member_of
from robotapp_scheduler.what_if.difference import Outcome, PodChange

TAINT_KEY: Final = "node.kubernetes.io/unreachable"
TAINTS: Final = tuple(Taint(key=TAINT_KEY, effect=effect) for effect in ("NoSchedule", "NoExecute"))
EVICTING: Final = TAINTS[1]
_UNTIL_DELETED: Final = "StatefulSet"
_PROGRAM: Final = "app.kubernetes.io/component"
_LACKS: Final = {
    "operator": "no app is changed and no status follows",
    "scheduler": "no pod of an app gets a node, so what is said here comes later",
    "console": "the web console does not answer",
}
"""Programs of the chart that are not on every node → what is lacking without one."""
SUCCESSOR: Final = "what-if/successor/"


def lost(node: Node) -> Node:
    """The node as the node controller marks it when its kubelet is silent."""
    taints = tuple(taint for taint in node.spec.taints if taint.key != TAINT_KEY)
    return msgspec.structs.replace(node, spec=msgspec.structs.replace(node.spec, taints=(*taints, *TAINTS)))


def fate(pod: Pod, node: str, cluster: Cache) -> PodChange | None:
    """What becomes of a pod of the lost node that gets no successor elsewhere; None for one that does."""
    owner = controller_of(pod.metadata.owner_references)
    if owner is None:
        return change_of(pod, cluster, Outcome.ENDS, from_=node, reason="it has no controller that makes it anew")
    if owner.kind == "DaemonSet":
        return change_of(pod, cluster, Outcome.STAYS, from_=node, reason="its DaemonSet needs it on this node alone")
    if _stays_for_good(pod):
        reason = f"it tolerates {TAINT_KEY} for good, so nothing evicts it"
        return change_of(pod, cluster, Outcome.STAYS, from_=node, reason=reason)
    if owner.kind == _UNTIL_DELETED:
        reason = "its StatefulSet waits until the pod or the node is deleted"
        return change_of(pod, cluster, Outcome.PENDING, from_=node, reason=reason)
    return _kept(pod, node, cluster)


def describe_own_program(pod: Pod, node: str) -> str:
    """Returns what stops while this pod is lost, where it is one of RobotApp's own programs that all robots need; else ""."""
    labels = pod.metadata.labels or {}
    lack = _LACKS.get(labels.get(_PROGRAM, "")) if labels.get(Label.PART_OF) == "robotapp" else None
    if lack is None or Label.APP_UID in labels:
        return ""
    name = f"{pod.metadata.namespace}/{pod.metadata.name}"
    return (
        f"RobotApp's own {labels[_PROGRAM]} {name} is on {node}: until it, or another replica, runs elsewhere, {lack}"
    )


def _stays_for_good(pod: Pod) -> bool:
    """Does the pod tolerate that its node is silent, without an end? Of several tolerations the first that matches counts, as for
    Kubernetes' eviction by taints; a pod without any has one of 300 s from the API server.
    """
    first = next((each for each in pod.spec.tolerations if tolerates(each, EVICTING)), None)
    return first is not None and first.toleration_seconds is None


def successor_of(pod: Pod) -> Pod:
    """The pod that its controller makes in place of this one."""
    meta = msgspec.structs.replace(pod.metadata, uid=SUCCESSOR + pod.metadata.uid, deletion_timestamp=None)
    return msgspec.structs.replace(pod, metadata=meta, spec=msgspec.structs.replace(pod.spec, node_name=""))


def change_of(pod: Pod, cluster: Cache, outcome: Outcome, **fields: str) -> PodChange:
    """What would become of the pod, with the app it belongs to."""
    meta, member = pod.metadata, member_of(pod.metadata.labels or {})
    app = cluster.apps.app(member.app_uid) if member is not None else None
    return PodChange(
        namespace=meta.namespace,
        pod=meta.name,
        app=app.source.metadata.name if app is not None else "",
        component=member.component if member is not None else "",
        instance=member.instance if member is not None else "",
        outcome=outcome,
        from_=fields.get("from_", ""),
        to=fields.get("to", ""),
        code=fields.get("code", ""),
        reason=fields.get("reason", ""),
    )


def _kept(pod: Pod, node: str, cluster: Cache) -> PodChange | None:
    """A component that does not fail over, and servers of an instance on its robot, stay with their node."""
    member = member_of(pod.metadata.labels or {})
    app = cluster.apps.app(member.app_uid) if member is not None else None
    if app is None or member is None:
        return None
    component = app.components.get(member.component)
    if component is None:
        on_robot = bool(cluster.nodes.on_robot(node))
        reason = "it serves the robot it is on"
        return change_of(pod, cluster, Outcome.STAYS, from_=node, reason=reason) if on_robot else None
    if fails_over(component) or component.on_disconnect == "Stop":
        return None
    return change_of(pod, cluster, Outcome.STAYS, from_=node, reason="onDisconnect: Keep")
