"""Components that wait for others (dependsOn): they start when these are ready, and run on when these cease to be."""

from collections.abc import Iterable, Sequence

from robotapp_api.model.names import Label
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment


def unmet_dependencies(app: App, deployments: Iterable[Deployment]) -> dict[str, tuple[str, ...]]:
    """Returns, by component that must not start yet, the components it waits for. deployments: of one instance.

    A component whose Deployment has pods has started. One that was stopped, by `suspend` for example, waits again.
    """
    if not app.orders_starts:
        return {}
    by_component = {
        item.metadata.labels.get(Label.COMPONENT, ""): item
        for item in deployments
        if item.metadata.controller_uid == app.uid
    }
    reached = {"Ready": {name for name, item in by_component.items() if item.is_ready}}
    unmet: dict[str, tuple[str, ...]] = {}
    for component in app.spec.components:
        own = by_component.get(component.name)
        if own is None or own.replicas == 0:
            names = tuple(each.component for each in component.depends_on if each.component not in reached[each.status])
            unmet |= {component.name: names} if names else {}
    return unmet


def describe_wait(app: App, names: Sequence[str]) -> str:
    """Returns what a component waits for; "" for nothing."""
    if not names:
        return ""
    suspended = {component.name for component in app.spec.components if component.replicas == 0}
    listed = [f"{name} (suspended by replicas: 0)" if name in suspended else name for name in names]
    return f"waits until {' and '.join(listed)} {'is' if len(names) == 1 else 'are'} Ready (dependsOn)"
