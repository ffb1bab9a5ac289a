"""Texts and small bodies of what users read about a pod: upstream's wording, because people and tools match on it."""

from typing import Any

from robotapp_scheduler.core.objects import Pod

NOTE_LIMIT = 1024
NOTE_CUT = 1020


def assigned(pod: Pod, node: str) -> str:
    return f"Successfully assigned {pod.key} to {node}"


def skipped_deleting(pod: Pod) -> str:
    return f"skip schedule deleting pod: {pod.key}"


def device_busy(device: str, node: str, *, holder: str, holder_namespace: str, namespace: str) -> str:
    """Who keeps a device from a pod in `namespace`; tenants do not see each other's names."""
    who = f"{holder_namespace}/{holder}" if holder_namespace == namespace else "another namespace"
    return f"device {device} on {node} is held by {who}: it is free when its holder is deleted or suspended"


def note(text: str) -> str:
    """An Event note holds 1024 bytes; a longer text is cut to 1020 and marked, the condition keeps all of it."""
    encoded = text.encode()
    if len(encoded) <= NOTE_LIMIT:
        return text
    return encoded[:NOTE_CUT].decode(errors="ignore") + " ..."


def unscheduled_patch(pod: Pod, *, reason: str, message: str, now: str) -> dict[str, Any]:
    """Strategic merge patch of `pods/status` that sets PodScheduled=False.

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
    return {"metadata": {"uid": pod.metadata.uid}, "status": {"conditions": [condition]}}


def says_already(pod: Pod, *, reason: str, message: str) -> bool:
    """Whether the stored pod carries exactly this condition."""
    return any(
        found.type == "PodScheduled" and found.status == "False" and (found.reason, found.message) == (reason, message)
        for found in pod.status.conditions or ()
    )


def _is_false(pod: Pod) -> bool:
    return any(found.type == "PodScheduled" and found.status == "False" for found in pod.status.conditions or ())
