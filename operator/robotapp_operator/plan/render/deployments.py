"""Renders components: a Deployment each, a Job for one with job, and a Job for each run of one with schedule."""

import dataclasses
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from robotapp_api.model.app.component import Component, Job
from robotapp_api.model.names import QUEUE_NAME, Annotation
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, Child, component_labels, selector
from robotapp_operator.plan.render.devices.resource_claim import name_claim
from robotapp_operator.plan.render.parameters import NONE, ParameterState
from robotapp_operator.plan.render.pod_template import pod_template
from robotapp_operator.plan.spec.desired import Desired, Domain
from robotapp_operator.plan.spec.objects import ChildRef


class RunTimes(NamedTuple):
    """The times that stand on a Job of a component with schedule."""

    due: datetime | None = None
    """Due time of its run; None for the mark, which never runs (`plan.diff.schedules`)."""
    settled: datetime | None = None
    """Due times until this time are not made up for."""


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
    """Returns the Deployments of the components that run on.

    running: False for no pods (suspended, or no domain to be had), while everything else stays. master_starts: by
    component. waiting: components without pods so far. claiming: components whose devices come by a ResourceClaim.
    attempt: number of the instance's attempt, "" for the first one. With another number all pods start anew.
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
    idle: Collection[str] = (),
    claiming: Collection[str] = (),
    run_times: Mapping[str, RunTimes] = {},
    attempt_annotations: Mapping[str, str] = {},
) -> list[Child]:
    """Returns the Jobs of the components with job.

    idle: components whose job has ended or is not due, so that it needs no device. run_times: by component with
    schedule, the times of the run it is to have. attempt_annotations: those of the instance's attempt, {} for the first
    one; a run of a schedule has none.
    """
    children = []
    for component in desired.app.spec.components:
        if component.job is None or (component.schedule is not None and component.name not in run_times):
            continue
        by_claim = component.name in claiming and component.name not in idle
        state = parameters.get(component.name, NONE)
        annotations = attempt_annotations if component.schedule is None else {}
        attempt = annotations.get(Annotation.ATTEMPT, "")
        template = pod_template(component, desired, domain=domain, state=state, attempt=attempt, by_claim=by_claim)
        if by_claim:
            template = name_claim(template, component, claim=desired.name_of(component.name))
        is_running = running and component.replicas > 0 and component.name not in {*waiting, *idle}
        if desired.app.queue and not is_running and component.name not in idle:
            continue  # kueue would resume a Job that we suspend: one that must not run is deleted
        times = run_times.get(component.name, RunTimes())
        child = _job(component, desired, component.job, template, running=is_running, times=times)
        children.append(dataclasses.replace(child, annotations={**child.annotations, **annotations}))
    return children


def name_run(desired: Desired, component: str, due: datetime | None) -> str:
    """Returns the name of the Job of a run, another one for each due time: the Job of the last run stays until that
    of the next one is there, and no due time can have two Jobs.
    """
    # A dot cannot occur in a component's name, so the hash differs from that of any other one.
    return desired.name_of(component if due is None else f"{component}.{due.astimezone(UTC):%Y%m%d%H%M}")


def _job(
    component: Component, desired: Desired, job: Job, template: dict[str, Any], *, running: bool, times: RunTimes
) -> Child:
    """Returns the Job of a component.

    A pod that was evicted, preempted or lost with its node is no failure of the program; and no second one is made
    while it may run.
    """
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
    records = {Annotation.DUE_AT.value: times.due, Annotation.SETTLED_AT.value: times.settled}
    return Child(
        ref=ChildRef(JOB, name_run(desired, component.name, times.due)),
        labels=component_labels(desired, component.name) | queue,
        spec=spec,
        annotations={Annotation.RUN_HASH.value: desired.app.run_hashes[component.name]}
        | {key: whole_seconds(time) for key, time in records.items() if time is not None},
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
    """Returns the spec. Recreate with at most one replica: two publishers of a command topic must never overlap.

    revisionHistoryLimit 0: an empty old ReplicaSet would keep naming a domain the instance no longer holds.
    """
    return {
        "replicas": replicas if running else 0,
        "revisionHistoryLimit": 0,
        "strategy": {"type": "Recreate" if replicas <= 1 else "RollingUpdate"},
        "selector": {"matchLabels": selector(labels)},
        "template": template,
    }
