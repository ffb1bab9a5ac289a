"""One Deployment per component per instance."""

from collections.abc import Mapping
from typing import Any

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import Annotation
from robotapp_operator.plan.render.child import DEPLOYMENT, Child, component_labels, selector
from robotapp_operator.plan.render.parameters import NONE, ParameterState
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Desired, Domain
from robotapp_operator.plan.spec.objects import ChildRef


def component_deployments(
    desired: Desired, *, domain: Domain | None, parameters: Mapping[str, ParameterState], running: bool
) -> list[Child]:
    """`running` False: no pods (suspended, or no domain to be had), everything else stays."""
    return [
        _deployment(component, desired, domain=domain, state=parameters.get(component.name, NONE), running=running)
        for component in desired.app.spec.components
    ]


def _deployment(
    component: Component, desired: Desired, *, domain: Domain | None, state: ParameterState, running: bool
) -> Child:
    labels = component_labels(desired, component.name)
    template = pod_template(component, desired, domain=domain, state=state)
    return Child(
        ref=ChildRef(DEPLOYMENT, desired.name_of(component.name)),
        labels=labels,
        spec=deployment_spec(labels, template, replicas=component.replicas, running=running),
        annotations={Annotation.CONFIG.value: state.record} if state.record else {},
        change=state.change,
    )


def deployment_spec(
    labels: dict[str, str], template: dict[str, Any], *, replicas: int, running: bool
) -> dict[str, Any]:
    """Recreate where there is one replica: two publishers of one command topic must never overlap.

    revisionHistoryLimit 0: an empty old ReplicaSet would keep naming a domain the instance no longer holds.
    """
    return {
        "replicas": replicas if running else 0,
        "revisionHistoryLimit": 0,
        "strategy": {"type": "Recreate" if replicas == 1 else "RollingUpdate"},
        "selector": {"matchLabels": selector(labels)},
        "template": template,
    }
