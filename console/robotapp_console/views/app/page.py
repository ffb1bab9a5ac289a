"""The screen of one app: conditions, components, edges with their budgets, events, commands."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import Condition as ConditionType
from robotapp_api.model.names import Label, Phase
from robotapp_console.views.fleet import colour_phase
from robotapp_console.views.links import ZoneEstimates, zones_of
from robotapp_console.views.objects import App, Condition, EdgeSpec, EdgeStatus, Event, Instance
from robotapp_console.views.problems import Problem, list_troubled, path_of_app
from robotapp_console.views.snapshot import Refusal, Snapshot
from robotapp_console.views.texts import clean, format_milliseconds, kubectl, parse_milliseconds

MOST_IN_FULL: Final = 5
"""Instances whose components and edges are shown, unless one is chosen."""
MOST_LISTED: Final = 200
MOST_EVENTS: Final = 20
_GOOD_WHEN_FALSE: Final = frozenset({ConditionType.PROGRESSING, ConditionType.STALLED})
_WELL: Final = frozenset({Phase.RUNNING, Phase.SUSPENDED})
MEDIAN: Final = 50


@dataclass(frozen=True, slots=True)
class ConditionRow:
    """One condition; `colour` is good, bad or busy (unknown)."""

    type: str
    status: str
    reason: str
    message: str
    since: str
    colour: str


@dataclass(frozen=True, slots=True)
class ComponentRow:
    name: str
    node: str
    ready: bool
    restarts: int
    message: str
    moved_at: str = ""
    moves: int = 0


@dataclass(frozen=True, slots=True)
class EdgeRow:
    """An edge and its budget. `known` is measured, estimated, same node or unknown; `share` is the part of the budget in percent."""

    topic: str
    ends: str
    time: str
    budget: str
    known: str
    share: int | None = None
    verdict: str = ""
    """met, exceeded or empty."""


@dataclass(frozen=True, slots=True)
class InstanceView:
    """An instance in full."""

    name: str
    phase: str
    colour: str
    domain: str
    message: str
    components: tuple[ComponentRow, ...]
    edges: tuple[EdgeRow, ...]
    edges_omitted: int
    claims: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class InstanceLine:
    """An instance as a line of the list."""

    name: str
    phase: str
    colour: str
    ready: str
    budget: str
    nodes: str
    href: str


@dataclass(frozen=True, slots=True)
class EventRow:
    at: str
    type: str
    reason: str
    note: str
    count: int


@dataclass(frozen=True, slots=True)
class Command:
    """A command line and what it is for."""

    purpose: str
    line: str


@dataclass(frozen=True, slots=True)
class AppView:
    """The whole page."""

    namespace: str
    name: str
    path: str
    uid: str
    is_suspended: bool
    phase: str
    colour: str
    facts: tuple[tuple[str, str], ...]
    outdated: bool
    """The operator has not seen the latest change yet."""
    problems: tuple[Problem, ...]
    conditions: tuple[ConditionRow, ...]
    instances: tuple[InstanceView, ...]
    lines: tuple[InstanceLine, ...]
    lines_omitted: int
    chosen: str
    """The robot the page was asked for; empty for all."""
    missing: bool
    """There is no instance of that name."""
    commands: tuple[Command, ...]
    refusals: tuple[Refusal, ...]


def build_app(snapshot: Snapshot, namespace: str, name: str, robot: str = "") -> AppView | None:
    """Returns the page of an app, None when there is no such app (or it may not be read: then the kind is in `refusals`)."""
    app = snapshot.apps.get(f"{namespace}/{name}")
    if app is None:
        return None
    instances = _order_instances(app, snapshot.instances.values())
    chosen = [item for item in instances if item.spec.instance == robot] if robot else instances[:MOST_IN_FULL]
    several = len(instances) > 1
    estimates = ZoneEstimates(zones_of(snapshot.nodes), snapshot.round_trips)
    return AppView(
        clean(namespace, 63),
        clean(name, 63),
        path_of_app(namespace, name),
        clean(app.metadata.uid, 36),
        app.spec.suspend,
        clean(app.status.phase or Phase.PENDING, 32),
        colour_phase(app.status.phase),
        _list_facts(app),
        app.status.observed_generation != app.metadata.generation,
        tuple(list_troubled(app)),
        tuple(_build_condition(condition) for condition in app.status.conditions),
        tuple(_build_instance(item, app.spec.edges, estimates) for item in chosen),
        tuple(_build_line(item, namespace, name) for item in instances[:MOST_LISTED]) if several else (),
        max(0, len(instances) - MOST_LISTED),
        clean(robot, 63),
        bool(robot) and not chosen,
        _list_commands(namespace, name, robot),
        snapshot.list_refusals("robotapps", "robotappinstances", "nodes", "nodetelemetries"),
    )


def _order_instances(app: App, instances: Iterable[Instance]) -> list[Instance]:
    """Returns the app's instances: those in trouble in the operator's order, then by name."""
    rank = {item.instance: position for position, item in enumerate(app.status.troubled)}
    instances_of_app = [item for item in instances if item.spec.app_uid == app.metadata.uid]
    return sorted(
        instances_of_app,
        key=lambda item: (
            rank.get(item.spec.instance, len(rank)),
            item.status.phase in _WELL,
            item.spec.instance,
        ),
    )


def _list_facts(app: App) -> tuple[tuple[str, str], ...]:
    summary, counts = app.status.summary, app.status.instance_counts
    facts = [
        ("components ready", summary.ready),
        ("robots ready", summary.robots if summary.robots != "-" else ""),
        ("domain", summary.domain),
        ("worst time / budget", summary.budget),
        ("devices held / wanted", summary.devices),
        ("middleware", summary.rmw),
        ("discovery", summary.discovery),
    ]
    words = ("offline", "completed", "failed")
    facts += [(f"instances {word}", str(getattr(counts, word) or "")) for word in words]
    return tuple((label, clean(value, 64)) for label, value in facts if value)


def _build_condition(condition: Condition) -> ConditionRow:
    good = "False" if condition.type in _GOOD_WHEN_FALSE else "True"
    colour = "busy" if condition.status == "Unknown" else "good" if condition.status == good else "bad"
    if condition.type == ConditionType.PROGRESSING and colour == "bad":
        colour = "busy"
    return ConditionRow(
        clean(condition.type, 64),
        clean(condition.status, 16),
        clean(condition.reason, 64),
        clean(condition.message),
        condition.last_transition_time,
        colour,
    )


def _build_instance(instance: Instance, edges: Sequence[EdgeSpec], estimates: ZoneEstimates) -> InstanceView:
    status = instance.status
    moves = {move.component: move.times for move in status.moves if move.times}
    percentiles = {_edge_key(edge): edge.latency.percentile for edge in edges if edge.latency}
    return InstanceView(
        clean(instance.spec.instance, 63),
        clean(status.phase or Phase.PENDING, 32),
        colour_phase(status.phase),
        "" if status.domain is None else str(status.domain),
        "" if status.phase in _WELL else clean(status.summary.message),
        tuple(
            ComponentRow(
                clean(component.name, 63),
                clean(component.node, 253),
                component.ready,
                component.restarts,
                clean(component.message),
                max(moves.get(component.name, ()), default=""),
                len(moves.get(component.name, ())),
            )
            for component in status.components
        ),
        tuple(build_edge(edge, estimates, percentile=percentiles.get(_edge_key(edge))) for edge in status.edges),
        status.edges_omitted,
        tuple(clean(claim, 120) for claim in status.claims),
    )


def _edge_key(edge: EdgeSpec | EdgeStatus) -> tuple[str, str, str, str]:
    return edge.kind, edge.topic, edge.from_, edge.to


def build_edge(edge: EdgeStatus, estimates: ZoneEstimates, *, percentile: int | None = None) -> EdgeRow:
    """Returns the row of an edge. Times are p95 except where a budget is about the median: then only the verdict counts."""
    budget, p95 = parse_milliseconds(edge.budget), parse_milliseconds(edge.p95)
    is_unreachable = edge.measured and p95 is None
    source = "measured" if edge.measured else "unknown" if p95 is None else "same node"
    if p95 is None and not is_unreachable and len(set(edge.nodes)) == 2:
        estimate = estimates.estimate(edge.nodes[0], edge.nodes[1])
        if estimate is not None:
            p95, source = estimate[0] / 1000, f"estimated ({', '.join(dict.fromkeys(estimate[1]))})"
    if is_unreachable:
        time, share = "unreachable", None
    else:
        time = "" if p95 is None else f"{format_milliseconds(p95)} ms"
        share = round(100 * p95 / budget) if p95 is not None and budget and percentile != MEDIAN else None
    verdict = "" if edge.met is None else "met" if edge.met else "exceeded"
    kind = "" if edge.kind == "Topic" else f" ({edge.kind})"
    median = ", median" if percentile == MEDIAN else ""
    return EdgeRow(
        clean(f"{edge.topic}{kind}", 255),
        clean(f"{edge.from_} → {edge.to}", 140),
        time,
        f"{format_milliseconds(budget)} ms{median}" if budget else "",
        clean(source, 160),
        share,
        verdict,
    )


def _build_line(instance: Instance, namespace: str, name: str) -> InstanceLine:
    summary = instance.status.summary
    return InstanceLine(
        clean(instance.spec.instance or "instance", 63),
        clean(instance.status.phase or Phase.PENDING, 32),
        colour_phase(instance.status.phase),
        clean(summary.ready, 32),
        clean(summary.budget, 32),
        clean(summary.nodes, 160),
        path_of_app(namespace, name, instance.spec.instance),
    )


def _list_commands(namespace: str, name: str, robot: str) -> tuple[Command, ...]:
    home = ("-n", namespace)
    only = ("--robot", robot) if robot else ()
    selector = f"{Label.APP}={name}" + (f",{Label.INSTANCE}={robot}" if robot else "")
    return (
        Command("conditions, edges and events on a terminal", kubectl("robotapp", "info", name, *home, *only)),
        Command("why each component runs where it runs", kubectl("robotapp", "explain", name, *home, *only)),
        Command("logs of all components", kubectl("logs", *home, "-l", selector, "--all-containers", "--prefix", "-f")),
        Command("its pods", kubectl("get", "pods", *home, "-l", selector, "-o", "wide")),
        Command("the objects made of it", kubectl("robotapp", "render", name, *home)),
    )


def build_events(events: Iterable[Event]) -> tuple[EventRow, ...]:
    """Returns the newest events, newest first."""
    newest = sorted(events, key=lambda event: event.last_seen, reverse=True)[:MOST_EVENTS]
    return tuple(
        EventRow(
            event.last_seen,
            clean(event.type, 32),
            clean(event.reason, 64),
            clean(event.note),
            event.series.count if event.series else 1,
        )
        for event in newest
    )


def suggest_apps(snapshot: Snapshot) -> Mapping[str, str]:
    """Returns paths of apps that there are, by name, for the page of one that there is not."""
    return {key: path_of_app(*key.split("/", 1)) for key in sorted(snapshot.apps)[:20]}
