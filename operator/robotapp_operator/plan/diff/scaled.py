"""Deployments of ours that another writer scaled: a HorizontalPodAutoscaler, or a person with `kubectl scale`.

The number of replicas is the app's, so it is set back, and an event says where to change it.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robotapp_api.model.names import OPERATOR_MANAGER, Annotation
from robotapp_operator.plan.render.child import Child
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job, Service

_AUTOSCALERS: Final = ("kube-controller-manager", "horizontal-pod-autoscaler")
"""Field managers under which the HorizontalPodAutoscaler's controller writes the scale."""


def note_scaled(
    app: App, child: Child, over: Deployment | Job | Service, managed_fields: Sequence[Mapping[str, Any]]
) -> str:
    """Returns the text of an event when others changed only the replicas of what was rendered for this spec, else ""."""
    if not isinstance(over, Deployment) or over.metadata.annotations.get(Annotation.CONTENT_HASH) != child.hash:
        return ""
    replicas = child.spec["replicas"]
    manager = _manager_of_replicas(managed_fields)
    if over.spec.get("replicas", 1) == replicas or manager == OPERATOR_MANAGER:
        return ""
    by = f"{manager} (a HorizontalPodAutoscaler)" if manager in _AUTOSCALERS else manager or "another writer"
    text = f"Deployment {child.ref.name} was scaled by {by} and is set back to {replicas}: {_cure(app, child)}"
    if manager in _AUTOSCALERS:
        text += "; delete the HorizontalPodAutoscaler, which a RobotApp does not follow"
    return text


def _cure(app: App, child: Child) -> str:
    name = app.written_name(child.component)
    index = next((number for number, component in enumerate(app.written.components) if component.name == name), None)
    if app.spec.suspend:
        return "the app is suspended; write spec.suspend: false"
    if index is None:
        return "an instance needs exactly so many of these pods"
    return f"the app decides; write spec.components[{index}].replicas of RobotApp {app.name}"


def _manager_of_replicas(managed_fields: Sequence[Mapping[str, Any]]) -> str:
    """Returns who wrote the replicas last; a write of the scale has an entry of its own."""
    managers = [
        (str(entry.get("time", "")), str(entry.get("manager", "")))
        for entry in managed_fields
        if "f:replicas" in ((entry.get("fieldsV1") or {}).get("f:spec") or {})
    ]
    return max(managers, default=("", ""))[1]
