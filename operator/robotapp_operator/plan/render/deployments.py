"""One Deployment per component per instance."""

from collections.abc import Collection, Mapping
from typing import Any

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import Annotation
from robotapp_operator.plan.render.child import DEPLOYMENT, Child, component_labels, selector
from robotapp_operator.plan.render.devices.resource_claim import name_claim
from robotapp_operator.plan.render.parameters import NONE, ParameterState
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Desired, Domain
from robotapp_operator.plan.spec.objects import ChildRef


def component_deployments(
    desired: Desired,
    *,
    domain: Domain | None,
    parameters: Mapping[str, ParameterState],
    running: bool,
    master_starts: Mapping[str, str] = {},
    waiting: Collection[str] = (),
    claiming: Collection[str] = (),
) -> list[Child]:
    """`running` False: no pods (suspended, or no domain to be had), everything else stays. master_starts: by component.
    waiting: components without pods so far. claiming: components whose devices come by a ResourceClaim.
    """
    children = []
    for component in desired.app.spec.components:
        state, starts = parameters.get(component.name, NONE), master_starts.get(component.name, "")
        template = pod_template(component, desired, domain=domain, state=state, master_starts=starts)
        if component.name in claiming:
            template = name_claim(template, component, claim=desired.name_of(component.name))
        is_running = running and component.name not in waiting
        children.append(_deployment(component, desired, template, state=state, running=is_running))
    return children


def _deployment(
    component: Component, desired: Desired, template: dict[str, Any], *, state: ParameterState, running: bool
) -> Child:
    labels = component_labels(desired, component.name)
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
    """Recreate where there is one replica at most: two publishers of one command topic must never overlap.

    revisionHistoryLimit 0: an empty old ReplicaSet would keep naming a domain the instance no longer holds.
    """
    return {
        "replicas": replicas if running else 0,
        "revisionHistoryLimit": 0,
        "strategy": {"type": "Recreate" if replicas <= 1 else "RollingUpdate"},
        "selector": {"matchLabels": selector(labels)},
        "template": template,
    }
