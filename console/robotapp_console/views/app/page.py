"""The screen of one app: conditions, components, edges with their budgets, events, commands."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import ROBOT_END, Label, Phase
from robotapp_api.model.names import Condition as ConditionType
from robotapp_api.values.approval import read_approval
from robotapp_api.values.replicas import expand_struct
from robotapp_claims.rules.instances import primary_node
from robotapp_console.views.app.addresses import LinkRow, build_links
from robotapp_console.views.app.edges import EdgeReader, EdgeRow
from robotapp_console.views.app.timeline import MoveTime
from robotapp_console.views.fleet import colour_phase
from robotapp_console.views.graph.picture import ROBOT, Node, Picture, draw_picture, read_lane
from robotapp_console.views.links import ZoneEstimates, read_zones
from robotapp_console.views.objects import App, ComponentStatus, Condition, Event, Instance, find_condition
from robotapp_console.views.problems import Problem, list_troubled, path_of_app
from robotapp_console.views.snapshot import Refusal, Snapshot
from robotapp_console.views.texts import clean, kubectl

MOST_IN_FULL: Final = 5
"""Instances whose components and edges are shown, unless one is chosen."""
MOST_LISTED: Final = 200
MOST_EVENTS: Final = 20
SUSPENDED: Final = "suspended"
DONE: Final = "done"
_GOOD_WHEN_FALSE: Final = frozenset({ConditionType.PROGRESSING, ConditionType.STALLED})
_WELL: Final = frozenset({Phase.RUNNING, Phase.SUSPENDED, Phase.COMPLETED})


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
    """One component. `state` is its word in column Ready: yes, no, done (its job has completed), or suspended (by `replicas: 0`, or with its
    app), and `colour` the word's.
    """

    name: str
    node: str
    state: str
    colour: str
    restarts: int
    message: str
    moved_at: str = ""
    moves: int = 0
    is_job: bool = False
    """Its program ends."""

    @property
    def wants_node(self) -> bool:
        """Returns whether it runs or is to run: not while it is suspended, nor after its job has completed."""
        return self.state not in (SUSPENDED, DONE)

    @property
    def place(self) -> str:
        """Returns the node in words."""
        return self.node or ("waits" if self.wants_node else "none")


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
    links: tuple[LinkRow, ...]
    claims: tuple[str, ...]
    moves: tuple[MoveTime, ...]
    picture: Picture | None = None
    """The graph; of several instances the first one alone has it, the others lead to a page of their own."""
    href: str = ""


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
    approval: str
    """The operator's version whose templates wait to be approved; empty when none do."""
    phase: str
    colour: str
    facts: tuple[tuple[str, str], ...]
    is_sweep: bool
    """Its instances are runs, and have no robots."""
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
    builder = _InstanceBuilder(snapshot, app)
    return AppView(
        clean(namespace, 63),
        clean(name, 63),
        path_of_app(namespace, name),
        clean(app.metadata.uid, 36),
        app.spec.suspend,
        read_approval(find_condition(app.status.conditions, ConditionType.PROGRESSING).message),
        clean(app.status.phase or Phase.PENDING, 32),
        colour_phase(app.status.phase),
        _list_facts(app),
        app.spec.matrix is not None,
        app.status.observed_generation != app.metadata.generation,
        tuple(list_troubled(app)),
        tuple(_build_condition(condition) for condition in app.status.conditions),
        tuple(builder.build(item, is_drawn=position == 0) for position, item in enumerate(chosen)),
        tuple(_build_line(item, namespace, name) for item in instances[:MOST_LISTED]) if several else (),
        max(0, len(instances) - MOST_LISTED),
        clean(robot, 63),
        bool(robot) and not chosen,
        _list_commands(app, robot),
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
    is_sweep = app.spec.matrix is not None
    facts = [
        ("runs" if is_sweep else "components ready", summary.ready),
        ("runs at work", str(counts.ready or "") if is_sweep else ""),
        ("robots ready", summary.robots if summary.robots != "-" else ""),
        ("domain", summary.domain),
        ("worst time / budget", summary.budget),
        ("devices held / wanted", summary.devices),
        ("middleware", summary.rmw),
        ("discovery", summary.discovery),
    ]
    words = ("offline",) if is_sweep else ("offline", "completed", "failed")
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


class _InstanceBuilder:
    """Makes the views of an app's instances; what they share is worked out once."""

    def __init__(self, snapshot: Snapshot, app: App) -> None:
        self._snapshot = snapshot
        self._app = app
        estimates = ZoneEstimates(read_zones(snapshot.nodes), snapshot.round_trips)
        spec = expand_struct(app.spec)
        self._suspended = frozenset(item.name for item in spec.components if item.replicas == 0 or spec.suspend)
        self._jobs = frozenset(item.name for item in spec.components if item.job is not None)
        self._edges = EdgeReader(spec.edges, estimates, snapshot.round_trips, self._suspended)

    def build(self, instance: Instance, *, is_drawn: bool) -> InstanceView:
        status = instance.status
        moves = {move.component: move.times for move in status.moves if move.times}
        robot_node = self._find_robot_node(instance)
        nodes = {component.name: component.node for component in status.components} | {ROBOT_END: robot_node}
        components = tuple(
            _build_component(
                item,
                moves.get(item.name, ()),
                is_suspended=item.name in self._suspended,
                is_job=item.name in self._jobs,
            )
            for item in status.components
        )
        edges = self._edges.build_rows(status.edges, nodes)
        name = clean(instance.spec.instance, 63)
        meta = self._app.metadata
        return InstanceView(
            name,
            clean(status.phase or Phase.PENDING, 32),
            colour_phase(status.phase),
            "" if status.domain is None else str(status.domain),
            "" if status.phase in _WELL else clean(status.summary.message),
            components,
            edges,
            build_links(status.links, namespace=meta.namespace, app=meta.name, robot=instance.spec.instance),
            tuple(clean(claim, 120) for claim in status.claims),
            tuple(MoveTime(clean(move.component, 63), at) for move in status.moves for at in move.times),
            self._draw(name, components, edges, robot_node) if is_drawn else None,
            path_of_app(meta.namespace, meta.name, instance.spec.instance),
        )

    def _find_robot_node(self, instance: Instance) -> str:
        """Returns the node that `@robot` means: by the nodes' labels, else by an edge that the operator observed; or none."""
        robot = instance.spec.robot
        if not robot:
            return ""
        computers = [node for node in self._snapshot.nodes.values() if node.labels.get(Label.ROBOT) == robot]
        if node := primary_node(robot, computers).node:
            return node
        for edge in instance.status.edges:
            if len(edge.nodes) == len(ends := (edge.from_, edge.to)) and ROBOT_END in ends:
                return edge.nodes[ends.index(ROBOT_END)]
        return ""

    def _draw(
        self, name: str, components: Sequence[ComponentRow], edges: Sequence[EdgeRow], robot_node: str
    ) -> Picture:
        """Returns the graph. The robot itself is drawn when an edge ends at it."""
        parts = [Node(row.name, row.node, row.colour, _describe_part(row)) for row in components]
        if any(ROBOT_END in (edge.source, edge.target) for edge in edges):
            parts.append(Node(ROBOT_END, clean(robot_node, 253), "idle", "The robot itself: sensors, drivers, base"))
        nodes = {clean(key, 253): node for key, node in self._snapshot.nodes.items()}

        def find_lane(node: str) -> int:
            labels = nodes[node].labels if node in nodes else None
            return ROBOT if node == robot_node else read_lane(labels)

        title = f"Graph of {clean(self._app.metadata.name, 63)}" + (f" on {name}" if name else "")
        are_tiers_known = "nodes" not in self._snapshot.refusals
        return draw_picture(title, parts, edges, lane_of=find_lane, are_tiers_known=are_tiers_known)


def _build_component(
    component: ComponentStatus, moves: tuple[str, ...], *, is_suspended: bool, is_job: bool
) -> ComponentRow:
    state, colour = ("yes", "good") if component.ready else ("no", "bad" if component.node else "busy")
    if component.completed:
        state = DONE
    elif is_suspended and not component.node:  # with a node its pod still ends
        state, colour = SUSPENDED, "idle"
    return ComponentRow(
        clean(component.name, 63),
        clean(component.node, 253),
        state,
        colour,
        component.restarts,
        clean(component.message),
        max(moves, default=""),
        len(moves),
        is_job,
    )


def _describe_part(row: ComponentRow) -> str:
    state = {"yes": "ready", "no": "not ready"}.get(row.state, row.state)
    place = f"on {row.node}" if row.node else "on no node"
    restarts = f", {row.restarts} restarts" if row.restarts else ""
    message = f": {row.message}" if row.message else ""
    return f"{row.name} {place}, {state}{restarts}{message}"


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


def _list_commands(app: App, robot: str) -> tuple[Command, ...]:
    namespace, name = app.metadata.namespace, app.metadata.name
    in_namespace = ("-n", namespace)
    on_robot = ("--robot", robot) if robot else ()
    selector = f"{Label.APP}={name}" + (f",{Label.INSTANCE}={robot}" if robot else "")
    words, value = ("start its pods again", "false") if app.spec.suspend else ("stop all its pods", "true")
    line = ("robotapp", "runs", name, *in_namespace)
    jobs = [component for component in app.spec.components if component.job is not None]
    # A job with schedule runs when it is due, so it is not repeated.
    can_repeat = any(component.schedule is None for component in jobs)
    runs = [Command("its runs", kubectl(*line))] if jobs else []
    runs += [Command("failed runs once more", kubectl(*line, "--failed"))] if can_repeat else []
    return (
        Command(
            "conditions, edges and events on a terminal", kubectl("robotapp", "info", name, *in_namespace, *on_robot)
        ),
        Command(
            "why each component runs where it runs", kubectl("robotapp", "explain", name, *in_namespace, *on_robot)
        ),
        Command(
            "logs of all components",
            kubectl("logs", *in_namespace, "-l", selector, "--all-containers", "--prefix", "-f"),
        ),
        Command("its pods", kubectl("get", "pods", *in_namespace, "-l", selector, "-o", "wide")),
        *runs,
        Command("the objects made of it", kubectl("robotapp", "render", name, *in_namespace)),
        Command("restart its components", kubectl("rollout", "restart", "deployment", *in_namespace, "-l", selector)),
        Command(
            words,
            kubectl(
                "patch", "robotapp", name, *in_namespace, "--type=merge", "-p", f'{{"spec": {{"suspend": {value}}}}}'
            ),
        ),
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
