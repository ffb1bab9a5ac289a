"""Components that wait for others (dependsOn): they start when these are ready, and run on when these cease to be."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.completion.endings import read_number
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job, Pod, pod_annotations


def unmet_dependencies(
    app: App,
    deployments: Iterable[Deployment],
    pods: Mapping[str, Sequence[Pod]] | None = None,
    jobs: Mapping[str, Job] = {},
    *,
    idle: Collection[str] = (),
    attempt: int = 0,
) -> dict[str, tuple[str, ...]]:
    """Returns, by component that must not start yet, the components it waits for. deployments: of one instance.

    A component whose Deployment has pods has started. One that was stopped, by `suspend` for example, waits again.
    jobs: by component, those of the present spec and of the present attempt. idle: components with nothing to start
    now. attempt: number of the present attempt. A Deployment whose template is of an earlier one has not started: its
    pods are about to end. pods: by their Deployment's uid; None where they are not known. They are looked at as well,
    because the status of a Deployment that is started anew may still count the pods it had before.
    """
    if not app.orders_starts:
        return {}
    by_component = {
        item.metadata.labels.get(Label.COMPONENT, ""): item
        for item in deployments
        if item.metadata.controller_uid == app.uid and (not attempt or _read_attempt(item) >= attempt)
    }
    names_by_status = {
        "Ready": {name for name, item in by_component.items() if _is_ready(item, pods)},
        "Complete": {name for name, job in jobs.items() if job.is_complete},
    }
    unmet: dict[str, tuple[str, ...]] = {}
    for component in app.spec.components:
        if component.name not in idle and not _has_started(component.name, by_component, jobs):
            names = tuple(
                dependency.component
                for dependency in component.depends_on
                if dependency.component not in names_by_status[dependency.status]
            )
            unmet |= {component.name: names} if names else {}
    return unmet


def _read_attempt(deployment: Deployment) -> int:
    """Returns the number of the attempt to which the Deployment's template belongs."""
    return read_number(pod_annotations(deployment.spec), Annotation.ATTEMPT)


def _has_started(component: str, deployments: Mapping[str, Deployment], jobs: Mapping[str, Job]) -> bool:
    if component in jobs:
        return jobs[component].may_run or jobs[component].verdict is not None
    return component in deployments and deployments[component].replicas > 0


def _is_ready(deployment: Deployment, pods: Mapping[str, Sequence[Pod]] | None) -> bool:
    if not deployment.is_ready or pods is None:
        return deployment.is_ready
    return sum(pod.is_ready for pod in pods.get(deployment.metadata.uid, ())) >= deployment.replicas


def describe_wait(app: App, names: Sequence[str]) -> str:
    """Returns what a component waits for; "" for nothing."""
    if not names:
        return ""
    suspended_names = {component.name for component in app.spec.components if component.replicas == 0}
    texts = [f"{name} (suspended by replicas: 0)" if name in suspended_names else name for name in names]
    jobs = {component.name for component in app.spec.components if component.job is not None}
    states = {True: "Complete", False: "Ready"}
    groups = [
        [item for item, name in zip(texts, names, strict=True) if (name in jobs) is ends] for ends in (False, True)
    ]
    parts = [
        f"{' and '.join(group)} {'is' if len(group) == 1 else 'are'} {states[ends]}"
        for ends, group in zip((False, True), groups, strict=True)
        if group
    ]
    return f"waits until {' and '.join(parts)} (dependsOn)"
