"""Components that wait for others (dependsOn): they start when these are ready, and run on when these cease to be."""

from collections.abc import Iterable, Mapping, Sequence

from robotapp_api.model.names import Label
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Pod


def unmet_dependencies(
    app: App, deployments: Iterable[Deployment], pods: Mapping[str, Sequence[Pod]] | None = None
) -> dict[str, tuple[str, ...]]:
    """Returns, by component that must not start yet, the components it waits for. deployments: of one instance.

    A component whose Deployment has pods has started. One that was stopped, by `suspend` for example, waits again.
    pods: by their Deployment's uid; None where they are not known. They are looked at as well, because the status of a Deployment
    that is started anew may still count the pods it had before.
    """
    if not app.orders_starts:
        return {}
    by_component = {
        item.metadata.labels.get(Label.COMPONENT, ""): item
        for item in deployments
        if item.metadata.controller_uid == app.uid
    }
    reached = {"Ready": {name for name, item in by_component.items() if _is_ready(item, pods)}}
    unmet: dict[str, tuple[str, ...]] = {}
    for component in app.spec.components:
        own = by_component.get(component.name)
        if own is None or own.replicas == 0:
            names = tuple(each.component for each in component.depends_on if each.component not in reached[each.status])
            unmet |= {component.name: names} if names else {}
    return unmet


def _is_ready(deployment: Deployment, pods: Mapping[str, Sequence[Pod]] | None) -> bool:
    if not deployment.is_ready or pods is None:
        return deployment.is_ready
    return sum(pod.is_ready for pod in pods.get(deployment.metadata.uid, ())) >= deployment.replicas


def describe_wait(app: App, names: Sequence[str]) -> str:
    """Returns what a component waits for; "" for nothing."""
    if not names:
        return ""
    suspended = {component.name for component in app.spec.components if component.replicas == 0}
    listed = [f"{name} (suspended by replicas: 0)" if name in suspended else name for name in names]
    return f"waits until {' and '.join(listed)} {'is' if len(names) == 1 else 'are'} Ready (dependsOn)"
