"""`nodes` and `robots`: where each stands in the network, what it has, and whether it can be heard.

How old an agent's report is, its object does not say: no field may change for its own sake. It is the time at which the API
server recorded the last write of the status (`metadata.managedFields`).
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from math import isinf
from statistics import median_low
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.placement.round_trips import RoundTrips, Rtt
from robotapp_api.values.quantities.bandwidth import parse_link_bandwidth
from robotapp_claims.rules.instances import primary_node
from robotapp_claims.rules.node_devices import FREE, HELD, NodeDevice
from robotapp_cli.commands.devices import devices_of, read_ledgers
from robotapp_cli.output import Column, Output, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json, age, condition, label, meta, short_ms, status
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import NODES, NODETELEMETRIES

_LOAD: Final = ("cpuPercent", "memoryPercent", "diskPercent", "gpuPercent", "networkBps")
_GAP: Final = 2
"""Eight columns fit into a terminal of 80 characters."""


class NodeView(msgspec.Struct, rename="camel"):
    """One node. Times are what the API server recorded; an empty text or None is not known."""

    node: str
    tier: str = ""
    robot: str = ""
    zone: str = ""
    rtt_zone: str = ""
    """The zone that `rtt_p95` leads to: the node's own, or where nothing is measured inside it the nearest."""
    rtt_p95: str = ""
    """The median of the measured pairs, such as 0.8ms; unreachable when most of them are."""
    devices: dict[str, int] = msgspec.field(default_factory=lambda: {"free": 0, "held": 0})
    arch: str = ""
    realtime: bool = False
    """The kernel is built for it."""
    jitter: str = ""
    """The median of the same pairs, such as 0.2ms."""
    load: dict[str, int] = msgspec.field(default_factory=dict)
    """As the agent reports it. Like the round trips and the four below, only while the agent is heard."""
    temperatures: dict[str, int] = msgspec.field(default_factory=dict)
    """Degrees Celsius by sensor."""
    battery: dict[str, int | bool] = msgspec.field(default_factory=dict)
    clock_offset_milliseconds: int | None = None
    reported_at: str = ""
    """When the agent last wrote."""
    silent: bool = False
    """The agent has missed three heartbeats: what it measured counts no more."""
    ready: bool = True
    offline_since: str = ""
    cordoned: bool = False
    """It takes no new pods: kubectl cordon, or a drain."""
    problem: str = ""
    """What is written on the node and cannot be read."""
    device_problem: str = ""
    """What is wrong with the rules for its devices, as its agent reports it."""


class RobotView(msgspec.Struct, rename="camel"):
    """One robot, by its primary node."""

    robot: str
    nodes: list[str]
    problem: str
    """Why it has no primary node; the first one is shown then."""
    primary: NodeView
    devices: dict[str, int]
    """Of all its nodes."""


class _Computer(NamedTuple):
    """A node with the labels that say what it is to its robot."""

    name: str
    labels: Mapping[str, str]
    view: NodeView


async def show_nodes(session: Session) -> None:
    """All nodes, by name."""
    found = [each.view for each in await _nodes(session)]
    if session.options.output.structured:
        write_structured({"nodes": msgspec.to_builtins(found)}, session.options.output)
    elif not found:
        print_line("The cluster has no nodes.")
    else:
        first = [Column("NODE", wraps=True, narrowest=15), Column("TIER")]
        _print(first, [([each.node, each.tier], each) for each in found], wide=_is_wide(session))
        _print_problems(found)


async def show_robots(session: Session) -> None:
    """All robots, by name."""
    robots = _robots(await _nodes(session))
    if session.options.output.structured:
        write_structured({"robots": msgspec.to_builtins(robots)}, session.options.output)
    elif not robots:
        text = f"No node belongs to a robot: kubectl label node NODE {Label.ROBOT}=NAME {Label.TIER}=robot"
        print_line(text)
    else:
        first = [Column("ROBOT", wraps=True, narrowest=10), Column("NODE", wraps=True, narrowest=10)]
        rows = [([each.robot, _computers(each)], each.primary) for each in robots]
        _print(first, rows, wide=_is_wide(session), devices=[each.devices for each in robots])
        for problem in filter(None, (each.problem for each in robots)):
            _warn(problem)


def _print_problems(nodes: Iterable[NodeView]) -> None:
    for node in nodes:
        if node.problem:
            _warn(node.problem)
        if node.device_problem:
            _warn(f"node {node.node}: {node.device_problem}")


def _warn(text: str) -> None:
    print_line(text, style="yellow")


def _is_wide(session: Session) -> bool:
    return session.options.output is Output.WIDE


async def _nodes(session: Session) -> list[_Computer]:
    """By name."""
    client = session.client
    nodes = (await client.list(NODES)).items
    telemetry = {meta(each)["name"]: each for each in (await client.list(NODETELEMETRIES)).items}
    ledgers = await read_ledgers(client, [meta(node)["name"] for node in nodes])
    devices = devices_of(nodes, list(telemetry.values()), ledgers)
    now_s = datetime.now(UTC).timestamp()
    trips = reported_round_trips(telemetry, now_s=now_s)
    zones = {meta(node)["name"]: label(node, Label.ZONE) for node in nodes}
    found = []
    for node in sorted(nodes, key=lambda node: str(meta(node)["name"])):
        name = meta(node)["name"]
        view = _view(node, telemetry.get(name), trips, now_s=now_s)
        view.rtt_zone, view.rtt_p95 = _to_zone(name, zones, trips)
        view.jitter = _jitter(telemetry.get(name), view.rtt_zone, zones)
        view.devices = _counted(devices.get(name, []))
        found.append(_Computer(name, meta(node).get("labels") or {}, view))
    return found


def _view(node: Json, telemetry: Json | None, trips: RoundTrips, *, now_s: float) -> NodeView:
    name = meta(node)["name"]
    ready = condition(node, "Ready")
    view = NodeView(name, label(node, Label.TIER), label(node, Label.ROBOT), label(node, Label.ZONE))
    view.problem = _unread_bandwidth(node)
    view.cordoned = bool((node.get("spec") or {}).get("unschedulable"))
    if ready.get("status") != "True":
        view.ready, view.offline_since = False, ready.get("lastTransitionTime") or ""
    if telemetry is not None:
        view.reported_at = written_at(telemetry)
        view.silent = bool(view.reported_at) and trips.silent_from_s(name) <= now_s
        _read(view, status(telemetry))
    return view


def _read(view: NodeView, report: Json) -> None:
    """What an agent reports, apart from round trips and devices."""
    view.arch = report.get("arch") or ""
    view.realtime = bool((report.get("kernel") or {}).get("realtime"))
    view.device_problem = report.get("deviceProblem") or ""
    if not view.silent:
        load = report.get("load") or {}
        view.load = {key: load[key] for key in _LOAD if key in load}
        view.temperatures = {each["name"]: each["celsius"] for each in report.get("temperatures") or ()}
        battery = report.get("battery") or {}
        view.battery = {key: battery[key] for key in ("percent", "charging") if key in battery}
        view.clock_offset_milliseconds = (report.get("clock") or {}).get("offsetMilliseconds")


def _unread_bandwidth(node: Json) -> str:
    text = (meta(node).get("annotations") or {}).get(Annotation.LINK_BANDWIDTH)
    try:
        parse_link_bandwidth("0" if text is None else text)
    except ValueError as error:
        return f"node {meta(node)['name']}: the link counts as unlimited, because its annotation {Annotation.LINK_BANDWIDTH} {error}"
    return ""


def written_at(telemetry: Json) -> str:
    """When the status was last written, as the API server recorded it; empty before the first time."""
    entries = meta(telemetry).get("managedFields") or []
    return max((str(each.get("time", "")) for each in entries if each.get("subresource") == "status"), default="")


def reported_round_trips(telemetry: Mapping[str, Json], *, now_s: float) -> RoundTrips:
    """What still counts of the reports, each as old as its last write."""
    found = RoundTrips()
    for name, each in telemetry.items():
        if written := written_at(each):
            entries = msgspec.convert(status(each).get("rtt") or [], list[Rtt])
            seq, interval_s = status(each).get("seq"), status(each).get("intervalSeconds")
            at_s = datetime.fromisoformat(written).timestamp()
            found.receive(name, entries, seq=seq, interval_s=interval_s, now_s=at_s)
    found.expire(now_s)
    return found


def _to_zone(node: str, zones: Mapping[str, str], trips: RoundTrips) -> tuple[str, str]:
    """The node's own zone or the nearest one, and the usual p95 to its nodes."""
    by_zone: dict[str, list[float]] = {}
    for peer, figures in trips.around(node).items():
        if zone := zones.get(peer):
            by_zone.setdefault(zone, []).append(figures.p95_us)
    usual = {zone: median_low(times) for zone, times in by_zone.items()}
    if not usual:
        return "", ""
    own = zones.get(node, "")
    zone = own if own in usual else min(usual, key=lambda each: (usual[each], each))
    return zone, "unreachable" if isinf(usual[zone]) else f"{short_ms(usual[zone] / 1000)}ms"


def _jitter(telemetry: Json | None, zone: str, zones: Mapping[str, str]) -> str:
    """The usual one between the node and those of a zone, "" where none was measured (an agent that is silent has no zone)."""
    entries = status(telemetry or {}).get("rtt") or () if zone else ()
    found = [each["jitterUs"] for each in entries if "jitterUs" in each and zones.get(each["peer"]) == zone]
    return f"{short_ms(median_low(found) / 1000)}ms" if found else ""


def _counted(devices: Iterable[NodeDevice]) -> dict[str, int]:
    states = [device.state for device in devices]
    return {"free": states.count(FREE), "held": states.count(HELD)}


def _robots(nodes: Iterable[_Computer]) -> list[RobotView]:
    by_robot: dict[str, list[_Computer]] = {}
    for node in nodes:
        if node.view.robot:
            by_robot.setdefault(node.view.robot, []).append(node)
    return [_robot(robot, found) for robot, found in sorted(by_robot.items())]


def _robot(robot: str, nodes: list[_Computer]) -> RobotView:
    primary = primary_node(robot, nodes)
    shown = next((node for node in nodes if node.name == primary.node), nodes[0])
    devices = {key: sum(node.view.devices[key] for node in nodes) for key in ("free", "held")}
    return RobotView(robot, [node.name for node in nodes], primary.problem, shown.view, devices)


def _computers(robot: RobotView) -> str:
    more = len(robot.nodes) - 1
    return robot.primary.node + (f" +{more}" if more else "")


def _print(
    first: list[Column],
    rows: list[tuple[list[str], NodeView]],
    *,
    wide: bool,
    devices: list[dict[str, int]] | None = None,
) -> None:
    """The columns both commands share, without those that would be empty (unless `wide`)."""
    counts = devices or [view.devices for _, view in rows]
    cells = [
        _cells(view, count) | (_wide_cells(view) if wide else {}) for (_, view), count in zip(rows, counts, strict=True)
    ]
    keys = [key for key in cells[0] if wide or any(each[key] for each in cells)]
    narrow = {"ZONE": 6, "RTT P95": 7, "AGENT": 6}
    columns = [*first, *(Column(key, wraps=key in narrow, narrowest=narrow.get(key, 0)) for key in keys)]
    print_table(
        columns,
        [[*names, *(each[key] for key in keys)] for (names, _), each in zip(rows, cells, strict=True)],
        gap=_GAP,
    )


def _cells(view: NodeView, devices: Mapping[str, int]) -> dict[str, str]:
    far = f" {view.rtt_zone}" if view.rtt_zone not in ("", view.zone) else ""
    written = age(view.reported_at)
    return {
        "ZONE": view.zone,
        "RTT P95": f"{view.rtt_p95}{far}",
        "FREE/HELD": f"{devices['free']}/{devices['held']}" if any(devices.values()) else "",
        "CPU/MEM": _percent(view, "cpuPercent", "memoryPercent"),
        "AGENT": f"silent {written}" if view.silent else written,
        "CORDONED": "yes" if view.cordoned else "",
        "OFFLINE": "" if view.ready else age(view.offline_since) or "yes",
    }


def _wide_cells(view: NodeView) -> dict[str, str]:
    offset = view.clock_offset_milliseconds
    hottest = max(view.temperatures.values(), default=None)
    power = " charging" if view.battery.get("charging") else ""
    return {
        "JITTER": view.jitter,
        "DISK/GPU": _percent(view, "diskPercent", "gpuPercent"),
        "NET": f"{view.load['networkBps'] / 1e6:.1f}Mbit/s" if "networkBps" in view.load else "",
        "TEMP": "" if hottest is None else f"{hottest}C",
        "BATTERY": f"{view.battery['percent']}%{power}" if "percent" in view.battery else "",
        "CLOCK": "" if offset is None else f"{offset:+}ms",
        "ARCH": f"{view.arch} realtime" if view.realtime else view.arch,
    }


def _percent(view: NodeView, *keys: str) -> str:
    """`12/48%`, with a dash for one that is not known, "" when none is."""
    known = [str(view.load.get(key, "-")) for key in keys]
    return "/".join(known) + "%" if view.load.keys() & set(keys) else ""
