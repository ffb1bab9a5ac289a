"""The screen of nodes: what they have and who uses it, and the round trips between zones."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.quantity import parse_bytes, parse_milli
from robotapp_api.values.quantities.requests import pod_requests
from robotapp_console.views.devices import NodeDevice, devices_by_node, list_ledger_refusals
from robotapp_console.views.links import ZoneMatrix, read_zones
from robotapp_console.views.objects import Load, Node, Pod, find_condition
from robotapp_console.views.paging import FAR, NAMESPACE, NEAR, Page, Query, take_page
from robotapp_console.views.snapshot import Refusal, Snapshot
from robotapp_console.views.texts import clean

SORTS: Final = ("node", "zone", "tier", "cpu", "memory", "heard")
FILTERS: Final = ("zone", "tier", NEAR, FAR, NAMESPACE)
MOST_DEVICES: Final = 6
_NO_ZONES: Final = ZoneMatrix((), ())
_FINISHED: Final = frozenset({"Succeeded", "Failed"})


@dataclass(frozen=True, slots=True)
class NodeRow:
    """One node. CPU is in thousandths of a core, memory in bytes; requested is None while the pods may not be read."""

    node: str
    robot: str
    zone: str
    tier: str
    cpu_milli: int = 0
    cpu_requested: int | None = None
    memory_bytes: int = 0
    memory_requested: int | None = None
    load: Load | None = None
    devices: tuple[NodeDevice, ...] = ()
    cordoned: bool = False
    shutting_down: bool = False
    not_ready_since: str = ""
    """`unknown` without a time."""
    reported_at: str = ""
    silent: bool = False
    problem: str = ""
    """The mistake in the rules for its devices, empty without one."""
    uid: str = ""

    @property
    def shown_devices(self) -> tuple[NodeDevice, ...]:
        return self.devices[:MOST_DEVICES]

    @property
    def more_devices(self) -> int:
        return max(0, len(self.devices) - MOST_DEVICES)

    @property
    def cpu_percent(self) -> int | None:
        return _share(self.cpu_requested, self.cpu_milli)

    @property
    def memory_percent(self) -> int | None:
        return _share(self.memory_requested, self.memory_bytes)


@dataclass(frozen=True, slots=True)
class Nodes:
    """All nodes by name, and the matrix of their zones."""

    rows: tuple[NodeRow, ...] = ()
    matrix: ZoneMatrix = _NO_ZONES
    zones: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ()
    refusals: tuple[Refusal, ...] = ()


def build_nodes(snapshot: Snapshot) -> Nodes:
    """Returns the screen's content; a column whose kind may not be read is empty."""
    devices = devices_by_node(snapshot)
    requested = None if "pods" in snapshot.refusals else sum_requests(snapshot.pods.values())
    rows = tuple(
        _build_row(node, devices.get(name, ()), requested, snapshot) for name, node in sorted(snapshot.nodes.items())
    )
    return Nodes(
        rows,
        snapshot.prepare_links(read_zones(snapshot.nodes)).find_matrix(),
        tuple(sorted({row.zone for row in rows if row.zone})),
        tuple(sorted({row.tier for row in rows if row.tier})),
        (
            *snapshot.list_refusals("nodes", "nodetelemetries"),
            *list_ledger_refusals(snapshot),
            *snapshot.list_refusals("pods"),
        ),
    )


def sum_requests(pods: Iterable[Pod]) -> dict[str, tuple[int, int]]:
    """Returns the CPU and memory that the pods of each node ask for, in thousandths and bytes."""
    sums: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for pod in pods:
        if pod.spec.node_name and pod.status.phase not in _FINISHED:
            wanted = _read_requests(pod)
            sums[pod.spec.node_name][0] += wanted.get("cpu", 0)
            sums[pod.spec.node_name][1] += wanted.get("memory", 0)
    return {node: (cpu, memory) for node, (cpu, memory) in sums.items()}


def _read_requests(pod: Pod) -> dict[str, int]:
    try:
        return pod_requests(pod.spec).exact
    except ValueError:
        return {}


def _build_row(
    node: Node, devices: tuple[NodeDevice, ...], requested: Mapping[str, tuple[int, int]] | None, snapshot: Snapshot
) -> NodeRow:
    name = node.name
    report = snapshot.telemetry.get(name)
    silent = snapshot.is_silent(name)
    ready = find_condition(node.status.conditions, "Ready")
    cpu, memory = (None, None) if requested is None else requested.get(name, (0, 0))
    return NodeRow(
        clean(name, 253),
        clean(node.labels.get(Label.ROBOT, ""), 63),
        clean(node.labels.get(Label.ZONE, ""), 63),
        clean(node.labels.get(Label.TIER, ""), 63),
        _read_amount(node, "cpu"),
        cpu,
        _read_amount(node, "memory"),
        memory,
        report.status.load if report and not silent else None,
        devices,
        node.spec.unschedulable,
        node.metadata.annotations.get(Annotation.GRACEFUL_SHUTDOWN) == "true",
        "" if ready.status == "True" else ready.last_transition_time or "unknown",
        report.written_at if report else "",
        silent,
        clean(report.status.device_problem) if report else "",
        node.metadata.uid,
    )


def _read_amount(node: Node, resource: str) -> int:
    text = node.status.allocatable.get(resource, "0")
    try:
        return parse_milli(text) if resource == "cpu" else parse_bytes(text)
    except ValueError:
        return 0


def _share(part: int | None, whole: int) -> int | None:
    return None if part is None or whole <= 0 else round(100 * part / whole)


_KEYS: Final = {
    "node": lambda row: row.node,
    "zone": lambda row: (row.zone, row.node),
    "tier": lambda row: (row.tier, row.node),
    "cpu": lambda row: (row.cpu_percent if row.cpu_percent is not None else -1, row.node),
    "memory": lambda row: (row.memory_percent if row.memory_percent is not None else -1, row.node),
    "heard": lambda row: (row.reported_at, row.node),
}


def read_nodes_query(parameters: Mapping[str, str]) -> Query:
    return Query.read(parameters, sorts=SORTS, filters=FILTERS)


def take_nodes_page(nodes: Nodes, query: Query) -> Page[NodeRow]:
    """Returns the rows to show."""
    zone, tier = query.filter_value("zone"), query.filter_value("tier")
    rows = [row for row in nodes.rows if (not zone or row.zone == zone) and (not tier or row.tier == tier)]
    return take_page(rows, query, keys=_KEYS, matches=_matches)


def _matches(row: NodeRow, word: str) -> bool:
    names = (row.node, row.robot, row.zone, row.tier, *(device.id for device in row.devices))
    holders = (device.holder for device in row.devices)
    return any(word in name.casefold() for name in (*names, *holders))
