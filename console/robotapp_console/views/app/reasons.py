"""Explains why each pod of an instance is where it is: the scheduler's record in words, and what the pod itself says."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.better_node import parse_better_node
from robotapp_api.values.placement.explanation import (
    describe_hardware,
    describe_refusals,
    describe_waiting,
    list_budgets,
)
from robotapp_api.values.placement.given_up import parse_given_up
from robotapp_api.values.quantities.duration import time_text
from robotapp_api.values.replicas import expand_replicas
from robotapp_console.views.objects import AppPod, find_condition
from robotapp_console.views.texts import clean

MOST_PODS: Final = 80
"""Pods of one instance that are explained; an app has 64 components at most, and helpers."""
MOST_REASONS: Final = 12
_NOT_SEEN: Final = "the scheduler has not looked at it yet"
Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ReasonRow:
    """One pod. `refused` are the nodes that were refused, a line each; `notes` is what else there is to say."""

    component: str
    pod: str
    node: str
    runner_up: str
    refused: tuple[str, ...]
    notes: tuple[str, ...]
    scores: tuple[tuple[str, int], ...] = ()
    is_recorded: bool = False


def select_pods(pods: Iterable[AppPod], robot: str) -> tuple[AppPod, ...]:
    """Returns the pods of one instance by component and name."""
    pods_of_robot = [pod for pod in pods if pod.metadata.labels.get(Label.INSTANCE, "") == robot]
    return tuple(sorted(pods_of_robot, key=lambda pod: (_name_component(pod), pod.metadata.name))[:MOST_PODS])


def find_trouble(app: Json, robot: str) -> str:
    """Returns the operator's sentence about an instance that needs somebody, such as who holds the device it waits for."""
    entries = (app.get("status") or {}).get("troubled") or []
    messages = (str(item.get("message") or "") for item in entries if item.get("instance", "") == robot)
    return clean(next(messages, ""))


def build_reasons(
    app: dict[str, Any], pods: Sequence[AppPod], records: Mapping[str, dict[str, Any]], *, robot: str
) -> tuple[ReasonRow, ...]:
    """Returns a row per pod; `records` are the scheduler's, by the pod's name."""
    nodes = {_name_component(pod): pod.spec.node_name for pod in pods}
    return tuple(_build_row(app, pod, records.get(pod.metadata.name), robot=robot, nodes=nodes) for pod in pods)


def list_without_pods(app: Json, pods: Iterable[AppPod]) -> tuple[str, ...]:
    """Returns the components that have no pod, such as those that are suspended or wait for others."""
    components_with_pods = {_name_component(pod) for pod in pods}
    names = (str(component["name"]) for component in expand_replicas(app["spec"]).get("components") or ())
    return tuple(clean(name, 63) for name in names if name not in components_with_pods)


def _name_component(pod: AppPod) -> str:
    """Returns the component, or in brackets what a helper of the app is, such as a discovery server."""
    labels = pod.metadata.labels
    return labels.get(Label.COMPONENT) or f"({labels.get(Label.NAME) or 'other'})"


def _build_row(
    app: dict[str, Any], pod: AppPod, record: dict[str, Any] | None, *, robot: str, nodes: Mapping[str, str]
) -> ReasonRow:
    component = _name_component(pod)
    condition = find_condition(pod.status.conditions, "PodScheduled")
    budgets = list_budgets(app, component, instance=robot, nodes=nodes)
    reasons = describe_refusals(record, budgets, hardware=describe_hardware(app, component)) if record else []
    if not pod.spec.node_name:
        waiting_reasons = describe_waiting(record, {"reason": condition.reason, "message": condition.message})
        reasons = [*waiting_reasons, *reasons] or [condition.message or _NOT_SEEN]
    top = (record or {}).get("top") or {}
    return ReasonRow(
        clean(component, 70),
        clean(pod.metadata.name, 253),
        clean(pod.spec.node_name, 253),
        clean(str((record or {}).get("runnerUp") or ""), 253),
        _shorten([clean(line) for line in reasons]),
        tuple(clean(note) for note in _list_notes(pod, record or {})),
        tuple(
            (clean(str(node), 253), int(total))
            for node, total in zip(top.get("nodes") or (), top.get("totals") or (), strict=False)
        ),
        record is not None,
    )


def _shorten(lines: list[str]) -> tuple[str, ...]:
    if len(lines) <= MOST_REASONS:
        return tuple(lines)
    return (*lines[: MOST_REASONS - 1], f"and {len(lines) - MOST_REASONS + 1} more")


def _list_notes(pod: AppPod, record: Json) -> Iterable[str]:
    """Gives the tier, the plan, devices, what was given up and a better node, as far as they are known."""
    if record.get("recomputed"):
        yield "No decision is on record: this is what the scheduler would decide now."
    yield from (str(record[key]) for key in ("tier", "planned") if record.get(key))
    if devices := record.get("devices"):
        yield f"holds {', '.join(map(str, devices))}"
    yield from _list_given_up(pod.metadata.annotations.get(Annotation.FALLBACK, ""))
    yield from _list_better_node(pod.metadata.annotations.get(Annotation.BETTER_NODE, ""))


def _list_given_up(annotation: str) -> Iterable[str]:
    """Gives the Preferred budgets and the tier that the app's fallback gave up for the node."""
    if not annotation:
        return
    try:
        given_up = parse_given_up(annotation)
    except ValueError as error:
        yield f"annotation {Annotation.FALLBACK} {error}"
        return
    for edge in given_up.edges:
        yield (
            f"gave up {edge.edge} to {edge.peer}: {time_text(edge.time_us)} ({edge.source}) is over the "
            f"Preferred budget of {time_text(edge.budget_us)}"
        )
    if given_up.tier:
        yield f"runs on tier {given_up.tier} instead of {', '.join(given_up.instead_of)}"


def _list_better_node(annotation: str) -> Iterable[str]:
    """Gives the scheduler's proposal of another node."""
    if not annotation:
        return
    try:
        better = parse_better_node(annotation)
    except ValueError as error:
        yield f"annotation {Annotation.BETTER_NODE} {error}"
        return
    times = f"{better.edge} {time_text(better.before_us)} here, {time_text(better.after_us)} there"
    yield f"{better.node} is proposed: {times}"
