"""One Deployment per component per instance, or one Job for a component that ends."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

from robotapp_api.model.app.component import Component, Job
from robotapp_api.model.names import QUEUE_NAME, Annotation
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, Child, component_labels, selector
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
    attempt: str = "",
) -> list[Child]:
    """`running` False: no pods (suspended, or no domain to be had), everything else stays. master_starts: by component.
    waiting: components without pods so far. claiming: components whose devices come by a ResourceClaim.
    attempt: number of the instance's, "" for the first one. With another one all pods start anew.
    """
    children = []
    for component in desired.app.spec.components:
        if component.job is not None:
            continue
        state, starts = parameters.get(component.name, NONE), master_starts.get(component.name, "")
        by_claim = component.name in claiming
        template = pod_template(
            component, desired, domain=domain, state=state, master_starts=starts, attempt=attempt, by_claim=by_claim
        )
        if by_claim:
            template = name_claim(template, component, claim=desired.name_of(component.name))
        is_running = running and component.name not in waiting
        children.append(_deployment(component, desired, template, state=state, running=is_running))
    return children


def component_jobs(
    desired: Desired,
    *,
    domain: Domain | None,
    parameters: Mapping[str, ParameterState],
    running: bool,
    waiting: Collection[str] = (),
    ended: Collection[str] = (),
    claiming: Collection[str] = (),
    annotations: Mapping[str, str] = {},
) -> list[Child]:
    """Returns the Jobs of the components that end. ended: those whose job has ended, so that it needs no device any more.

    annotations: those by which Jobs of another attempt than the first one are known.
    """
    attempt = annotations.get(Annotation.ATTEMPT, "")
    children = []
    for component in desired.app.spec.components:
        if component.job is None:
            continue
        by_claim = component.name in claiming and component.name not in ended
        state = parameters.get(component.name, NONE)
        template = pod_template(component, desired, domain=domain, state=state, attempt=attempt, by_claim=by_claim)
        if by_claim:
            template = name_claim(template, component, claim=desired.name_of(component.name))
        is_running = running and component.replicas > 0 and component.name not in {*waiting, *ended}
        if desired.app.queue and not is_running and component.name not in ended:
            continue  # kueue would resume a Job that we suspend: one that must not run is deleted
        child = _job(component, desired, component.job, template, running=is_running)
        children.append(dataclasses.replace(child, annotations={**child.annotations, **annotations}))
    return children


def _job(component: Component, desired: Desired, job: Job, template: dict[str, Any], *, running: bool) -> Child:
    """A pod that was evicted, preempted or lost with its node is no failure of the program; and no second one is made while it may run."""
    lost = {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]}
    spec: dict[str, Any] = {
        "suspend": not running or bool(desired.app.queue),
        "completions": 1,
        "parallelism": 1,
        "backoffLimit": job.backoff_limit,
        "podReplacementPolicy": "Failed",
        "podFailurePolicy": {"rules": [lost]},
        "template": {**template, "spec": {**template["spec"], "restartPolicy": "Never"}},
    }
    queue = {QUEUE_NAME: desired.app.queue} if desired.app.queue else {}
    if job.active_deadline_seconds is not None:
        spec["activeDeadlineSeconds"] = job.active_deadline_seconds
    return Child(
        ref=ChildRef(JOB, desired.name_of(component.name)),
        labels=component_labels(desired, component.name) | queue,
        spec=spec,
        annotations={Annotation.RUN_HASH.value: desired.app.run_hashes[component.name]},
    )


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
