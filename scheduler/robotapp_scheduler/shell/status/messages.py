"""Texts of Events and conditions of pods, and patches of their status. Upstream's wording, because people and tools match on it."""

from typing import Any

from robotapp_api.model.names import Label
from robotapp_claims.rules.identity import shown_name
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.preemption.preemption import BY_SCHEDULER

DISRUPTION = "DisruptionTarget"
NOTE_LIMIT = 1024
NOTE_CUT = 1020


def assigned(pod: Pod, node: str) -> str:
    return f"Successfully assigned {pod.key} to {node}"


def budget_without_end() -> str:
    """Appended to the Event Scheduled of a pod whose latency_budget has no effect."""
    return (
        "; its latency_budget has no effect, because it has no other end: write master_node or peer_pods, "
        f"or the label {Label.ROBOT}"
    )


def device_busy(device: str, node: str, *, holder: str, holder_namespace: str, namespace: str) -> str:
    """Which holder keeps a device from a pod in `namespace`."""
    holder_name = shown_name(holder_namespace, holder, for_namespace=namespace)
    return f"device {device} on {node} is held by {holder_name}: it is free when its holder is deleted or suspended"


def note(text: str) -> str:
    """An Event note holds 1024 bytes; a longer text is cut to 1020 and marked, the condition keeps all of it."""
    encoded = text.encode()
    if len(encoded) <= NOTE_LIMIT:
        return text
    return encoded[:NOTE_CUT].decode(errors="ignore") + " ..."


def rejected_by_kubelet(node: str, reason: str, message: str) -> str:
    return f"{node} refused the pod after it was bound there: {reason}" + (f": {message}" if message else "")


def preempted(preemptor_uid: str, node: str) -> str:
    return f"Preempted by pod {preemptor_uid} on node {node}"


def disruption_patch(pod: Pod, *, by: str, now: str) -> dict[str, Any]:
    """Strategic merge patch of `pods/status`: the pod is about to be deleted for one of higher priority."""
    condition = {
        "type": DISRUPTION,
        "status": "True",
        "reason": BY_SCHEDULER,
        "message": f"{by}: preempting to accommodate a higher priority pod",
        "observedGeneration": pod.metadata.generation,
        "lastTransitionTime": now,
    }
    return {"metadata": {"uid": pod.metadata.uid}, "status": {"conditions": [condition]}}


def is_disrupted(pod: Pod) -> bool:
    """Whether the pod carries that condition already."""
    return any(
        (found.type, found.status, found.reason) == (DISRUPTION, "True", BY_SCHEDULER)
        for found in pod.status.conditions or ()
    )


def clear_nomination_patch(pod: Pod) -> dict[str, Any]:
    """Strategic merge patch of `pods/status` that clears the nominated node."""
    return {"metadata": {"uid": pod.metadata.uid}, "status": {"nominatedNodeName": None}}


def unscheduled_patch(pod: Pod, *, reason: str, message: str, now: str, nominate: str | None = None) -> dict[str, Any]:
    """Strategic merge patch of `pods/status` that sets PodScheduled=False, and the nominated node unless None.

    The uid is a precondition: a pod re-created under the same name is left alone. `lastTransitionTime` is written only
    when the status changes to False.
    """
    condition: dict[str, Any] = {
        "type": "PodScheduled",
        "status": "False",
        "reason": reason,
        "message": message,
        "observedGeneration": pod.metadata.generation,
    }
    if not _is_false(pod):
        condition["lastTransitionTime"] = now
    status: dict[str, Any] = {"conditions": [condition]}
    if not nominated(pod, nominate):
        status["nominatedNodeName"] = nominate or None
    return {"metadata": {"uid": pod.metadata.uid}, "status": status}


def nominated(pod: Pod, node: str | None) -> bool:
    """Whether the stored pod names this node ("" = none; None = whichever)."""
    return node is None or pod.status.nominated_node_name == node


def shows_already(pod: Pod, *, reason: str, message: str, nominate: str | None = None) -> bool:
    """Whether the stored pod carries exactly this condition and nominated node (None = whichever)."""
    return nominated(pod, nominate) and any(
        found.type == "PodScheduled" and found.status == "False" and (found.reason, found.message) == (reason, message)
        for found in pod.status.conditions or ()
    )


def _is_false(pod: Pod) -> bool:
    return any(found.type == "PodScheduled" and found.status == "False" for found in pod.status.conditions or ())
