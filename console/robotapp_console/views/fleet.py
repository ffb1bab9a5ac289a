"""The first screen: robots as rows, problems on top."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from robotapp_api.model.names import Label, Phase
from robotapp_claims.rules.instances import primary_node
from robotapp_console.views.devices import (
    NodeDevice,
    count_devices,
    devices_by_node,
    find_hidden,
    list_device_claims,
    list_ledger_refusals,
)
from robotapp_console.views.history import Sparkline, draw_sparkline
from robotapp_console.views.links import Link, NodeLinks, read_zones
from robotapp_console.views.objects import Battery, Load, Node, find_condition
from robotapp_console.views.paging import NAMESPACE, Page, Query, take_page
from robotapp_console.views.problems import Problems, find_problems, path_of_app
from robotapp_console.views.snapshot import Refusal, Snapshot
from robotapp_console.views.texts import clean

SORTS: Final = ("robot", "zone", "link", "apps", "devices", "load", "battery")
FILTERS: Final = ("zone", "state", NAMESPACE)
STATES: Final = ("troubled", "offline", "idle")
MOST_CHIPS: Final = 8
MOST_LOOSE: Final = 60
_NO_PROBLEMS: Final = Problems((), 0)
_NO_LINK: Final = Link()
_WELL: Final = frozenset({"good", "idle"})
_COLOURS: Final = {
    Phase.RUNNING: "good",
    Phase.SUSPENDED: "idle",
    Phase.STOPPING: "idle",
    Phase.COMPLETED: "idle",
    Phase.PENDING: "busy",
    Phase.PLACING: "busy",
    Phase.DEGRADED: "bad",
    Phase.OFFLINE: "bad",
    Phase.FAILED: "bad",
}


@dataclass(frozen=True, slots=True)
class Chip:
    """An app on a robot. `colour` is one of good, busy, bad and idle; the phase stands beside it as a word."""

    name: str
    phase: str
    colour: str
    href: str
    troubled: bool = False
    """The operator lists the instance among those that need somebody."""


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot. `None` and empty texts are not known."""

    robot: str
    zone: str = ""
    nodes: tuple[str, ...] = ()
    primary: str = ""
    link: Link = _NO_LINK
    chips: tuple[Chip, ...] = ()
    held: int = 0
    free: int = 0
    load: Load | None = None
    battery: Battery | None = None
    silent: bool = False
    offline_since: str = ""
    """When the primary node stopped being ready; `unknown` without a time."""

    @property
    def is_troubled(self) -> bool:
        return bool(self.offline_since) or any(chip.troubled or chip.colour == "bad" for chip in self.chips)

    @property
    def shown_chips(self) -> tuple[Chip, ...]:
        return self.chips[:MOST_CHIPS]

    @property
    def more_chips(self) -> int:
        return max(0, len(self.chips) - MOST_CHIPS)


@dataclass(frozen=True, slots=True)
class Fleet:
    """The whole fleet; a page of it is taken by `take_fleet_page`."""

    rows: tuple[RobotRow, ...] = ()
    loose: tuple[Chip, ...] = ()
    """Apps without a robot."""
    loose_total: int = 0
    problems: Problems = _NO_PROBLEMS
    zones: tuple[str, ...] = ()
    counts: Mapping[str, int | None] = field(default_factory=dict)
    """None for what may not be read."""
    refusals: tuple[Refusal, ...] = ()
    has_apps: bool = False


class _Surroundings(NamedTuple):
    """Values that are computed once for all robots."""

    devices: Mapping[str, tuple[NodeDevice, ...]]
    zones: Mapping[str, str]
    links: NodeLinks
    snapshot: Snapshot


def build_fleet(snapshot: Snapshot) -> Fleet:
    """Returns every robot of which a node or an instance is known, by name."""
    computers: dict[str, list[Node]] = defaultdict(list)
    for _, node in sorted(snapshot.nodes.items()):
        if robot := node.labels.get(Label.ROBOT):
            computers[robot].append(node)
    chips, loose = _group_chips(snapshot)
    devices = devices_by_node(snapshot)
    zones = read_zones(snapshot.nodes)
    around = _Surroundings(devices, zones, snapshot.prepare_links(zones), snapshot)
    rows = tuple(
        _build_row(robot, computers.get(robot, []), tuple(chips.get(robot, ())), around)
        for robot in sorted(computers.keys() | chips.keys())
    )
    return Fleet(
        rows,
        tuple(loose[:MOST_LOOSE]),
        len(loose),
        find_problems(snapshot),
        tuple(sorted({row.zone for row in rows if row.zone})),
        _count(rows, snapshot),
        (
            *snapshot.list_refusals("robotapps", "robotappinstances", "nodes", "nodetelemetries"),
            *list_ledger_refusals(snapshot),
            *snapshot.list_refusals("domainpools"),
        ),
        bool(snapshot.apps),
    )


def measure_links(snapshot: Snapshot) -> dict[str, float]:
    """Returns the present p95 in microseconds of each robot's nodes, for the history."""
    links = snapshot.prepare_links(read_zones(snapshot.nodes))
    robots = (name for name, node in snapshot.nodes.items() if node.labels.get(Label.ROBOT))
    times = {name: links.find(name).p95_us for name in robots}
    return {name: time for name, time in times.items() if time is not None}


def colour_phase(phase: str) -> str:
    """Returns the colour of a phase; one of a newer operator that is not known here is busy."""
    return _COLOURS.get(phase, "busy")  # type: ignore[call-overload,no-any-return]


def _group_chips(snapshot: Snapshot) -> tuple[dict[str, list[Chip]], list[Chip]]:
    """Returns the apps of each robot, those that need somebody first, and those without a robot."""
    troubled_instances = {
        (app.metadata.uid, item.instance) for app in snapshot.apps.values() for item in app.status.troubled
    }
    chips: dict[str, list[Chip]] = defaultdict(list)
    loose: list[Chip] = []
    for instance in snapshot.instances.values():
        spec, phase = instance.spec, instance.status.phase or str(Phase.PENDING)
        chip = Chip(
            clean(spec.app, 63),
            clean(phase, 32),
            colour_phase(phase),
            path_of_app(instance.metadata.namespace, spec.app, spec.robot),
            (spec.app_uid, spec.instance) in troubled_instances,
        )
        (chips[spec.robot] if spec.robot else loose).append(chip)
    for group in (*chips.values(), loose):
        group.sort(key=lambda chip: (not chip.troubled, chip.colour in _WELL, chip.name, chip.href))
    return chips, loose


def _build_row(
    robot: str,
    nodes: list[Node],
    chips: tuple[Chip, ...],
    around: _Surroundings,
) -> RobotRow:
    snapshot = around.snapshot
    if not nodes:
        return RobotRow(clean(robot, 63), chips=chips)
    primary = primary_node(robot, nodes).node or nodes[0].name
    node = next(node for node in nodes if node.name == primary)
    report = snapshot.telemetry.get(primary)
    silent = snapshot.is_silent(primary)
    device_counts = count_devices(device for item in nodes for device in around.devices.get(item.name, ()))
    ready = find_condition(node.status.conditions, "Ready")
    return RobotRow(
        clean(robot, 63),
        clean(around.zones.get(primary, ""), 63),
        tuple(clean(item.name, 253) for item in nodes),
        primary,
        around.links.find(primary),
        chips,
        *device_counts,
        report.status.load if report and not silent else None,
        report.status.battery if report and not silent else None,
        silent,
        "" if ready.status == "True" else ready.last_transition_time or "unknown",
    )


def _count(rows: tuple[RobotRow, ...], snapshot: Snapshot) -> dict[str, int | None]:
    phases = [app.status.phase for app in snapshot.apps.values()]
    claims = snapshot.claims.values()
    counts = {
        "robots": ("robotappinstances", len(rows)),
        "offline": ("nodes", sum(bool(row.offline_since) for row in rows)),
        "apps": ("robotapps", len(phases)),
        "running": ("robotapps", phases.count(Phase.RUNNING)),
        "held": ("robotclaims", len(list_device_claims(snapshot))),
        "domains": ("robotclaims", sum(claim.spec.domain is not None for claim in claims)),
    }
    if "nodes" not in snapshot.refusals:  # then robots are known without their instances
        counts["robots"] = ("nodes", len(rows))
    known = {name: None if plural in snapshot.refusals else count for name, (plural, count) in counts.items()}
    return known | ({"held": None} if find_hidden(snapshot) else {})


_KEYS: Final = {
    "robot": lambda row: row.robot,
    "zone": lambda row: (row.zone, row.robot),
    "link": lambda row: (row.link.p95_us is None, row.link.p95_us or 0.0, row.robot),
    "apps": lambda row: (not row.is_troubled, -len(row.chips), row.robot),
    "devices": lambda row: (row.held, row.free, row.robot),
    "load": lambda row: (_percent(row.load), row.robot),
    "battery": lambda row: (row.battery.percent if row.battery else inf, row.robot),
}


def _percent(load: Load | None) -> float:
    return -1.0 if load is None or load.cpu_percent is None else float(load.cpu_percent)


def read_fleet_query(parameters: Mapping[str, str]) -> Query:
    return Query.read(parameters, sorts=SORTS, filters=FILTERS)


def take_fleet_page(fleet: Fleet, query: Query) -> Page[RobotRow]:
    """Returns the rows to show."""
    zone, state = query.filter_value("zone"), query.filter_value("state")
    rows = [row for row in fleet.rows if (not zone or row.zone == zone) and _is_in_state(row, state)]
    return take_page(rows, query, keys=_KEYS, matches=_matches)


def _is_in_state(row: RobotRow, state: str) -> bool:
    if state == "troubled":
        return row.is_troubled
    if state == "offline":
        return bool(row.offline_since)
    return not row.chips if state == "idle" else True


def _matches(row: RobotRow, word: str) -> bool:
    names = (row.robot, row.zone, *row.nodes, *(chip.name for chip in row.chips), *(chip.phase for chip in row.chips))
    return any(word in name.casefold() for name in names)


def draw_links(page: Page[RobotRow], snapshot: Snapshot) -> dict[str, Sparkline]:
    """Returns the picture of each shown robot's link, by robot."""
    return {row.robot: draw_sparkline(snapshot.history.list_values(row.primary)) for row in page.rows}
