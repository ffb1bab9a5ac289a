"""Reads from the events of pods why their containers wait for volumes, devices or networks."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from robotapp_operator.plan.spec.objects import Pod
from robotapp_operator.plan.status.pods.pod_failures import PULLING

MAX_WARNING_CHARACTERS: Final = 512


class PodWarning(NamedTuple):
    """An event of type Warning about a pod."""

    reason: str
    note: str


_BEFORE_CONTAINERS: Final = frozenset(
    {
        "FailedMount",
        "FailedAttachVolume",
        "FailedMapVolume",
        "FailedCreatePodSandBox",
        "FailedToRetrieveImagePullSecret",
        "FailedPrepareDynamicResources",
    }
)
"""Reasons of the kubelet's and the volume controller's events about what a pod needs before its containers start."""
_ABSENT: Final = ("not found", "non-existent", "Unable to retrieve some image pull secrets")
_CREATING: Final = frozenset({"ContainerCreating", "PodInitializing"})


def awaits_containers(pod: Pod) -> bool:
    """Returns whether the pod is on a node and its containers are not made yet, or their image does not come: only its events tell why."""
    if pod.terminal or pod.metadata.deletion_timestamp or not pod.spec.node_name:
        return False
    statuses = (*pod.status.init_container_statuses, *pod.status.container_statuses)
    waiting = [status.state.waiting.reason for status in statuses if status.state.waiting]
    return any(reason in PULLING for reason in waiting) or awaits_sandbox(pod)


def awaits_sandbox(pod: Pod) -> bool:
    """Returns whether volumes, devices or network of the pod are not there yet, as its kubelet reports it: no image is pulled before."""
    statuses = (*pod.status.init_container_statuses, *pod.status.container_statuses)
    waiting = [status.state.waiting.reason for status in statuses if status.state.waiting]
    mounted = any(
        condition.type == "PodReadyToStartContainers" and condition.status == "True"
        for condition in pod.status.conditions
    )
    # Without a status no kubelet has seen it, so there is no event either.
    return bool(statuses) and not mounted and len(waiting) == len(statuses) and _CREATING.issuperset(waiting)


def explain_warnings(warnings: Sequence[PodWarning]) -> str:
    """Returns why a pod does not get to its containers, "" where nothing says it. warnings: newest first.

    A sentence that names an absent object comes before others: after two minutes the kubelet reports a mere timeout as well.
    """
    telling = [warning for warning in warnings if warning.reason in _BEFORE_CONTAINERS]
    absent = [warning for warning in telling if any(words in warning.note for words in _ABSENT)]
    for warning in (*absent, *telling):
        cure = "; create it, or write optional: true" if warning in absent and warning.reason == "FailedMount" else ""
        return f"{warning.reason}: {' '.join(warning.note.split())[:MAX_WARNING_CHARACTERS]}{cure}"
    return ""
