"""Judges where a reference application is placed on simulated nodes: which promises of its RobotApp hold, which plugins decided. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from campaigns.reference.catalogue import (
    CLOUD,
    CLOUD_ZONE,
    EDGE,
    EDGE_TO_CLOUD_MS,
    EDGE_ZONE,
    FLEET,
    ROBOT,
    ROBOT_TO_CLOUD_MS,
    ROBOT_TO_EDGE_MS,
    SCENARIOS,
    SENSOR,
    Scenario,
)
from robotapp_api.values.placement.explanation import describe_refusals
from robotapp_api.values.quantities.duration import parse_us
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import SimulatedNode, Tier, cloud, edge, robot

Json = dict[str, Any]
EDGE_2, CLOUD_2 = "edge-2", "cloud-2"
EDGE_TO_EDGE_MS: Final = 7.5


@dataclass(frozen=True, slots=True)
class Placement:
    """One application as one scheduler placed it. `promises` are sentences, and whether they hold there."""

    app: str
    scheduler: str
    repetition: int
    nodes: Mapping[str, str]
    promises: Mapping[str, bool]
    decisions: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """By component, in our scheduler's record: what refused nodes, and what preferred the chosen one to the next."""
    plugins: Sequence[str] = ()
    """Plugins that refused a node or made a difference in score for any of the components."""

    @property
    def kept(self) -> int:
        return sum(self.promises.values())

    @property
    def broken(self) -> list[str]:
        return [promise for promise, is_kept in self.promises.items() if not is_kept]


def make_topology() -> Topology:
    """Returns the nodes of all scenarios in one cluster, with a second edge in another zone and a second cloud zone."""
    nodes = [
        robot(ROBOT, devices=[SENSOR]),
        *(robot(name) for name in FLEET),
        edge(EDGE, zone=EDGE_ZONE),
        edge(EDGE_2, zone="edge-zone-2"),
        cloud(CLOUD, zone=CLOUD_ZONE),
        cloud(CLOUD_2, zone="cloud-zone-2"),
    ]
    return Topology(nodes, rtt_ms={(a.name, b.name): _rtt_ms(a, b) for a in nodes for b in nodes if a.name < b.name})


def _rtt_ms(node: SimulatedNode, other_node: SimulatedNode) -> float:
    """Returns the round trip of two nodes. The far edge is as near to the cloud as the near one, and further from the robots."""
    tiers = {node.tier, other_node.tier}
    if Tier.CLOUD in tiers:
        return 2 * (ROBOT_TO_CLOUD_MS if Tier.ROBOT in tiers else EDGE_TO_CLOUD_MS if Tier.EDGE in tiers else 1.0)
    if EDGE_2 in {node.name, other_node.name}:
        return 2 * EDGE_TO_EDGE_MS
    return 2 * ROBOT_TO_EDGE_MS


def list_promises(scenario: Scenario, app: Json, nodes: Mapping[str, str], topology: Topology) -> dict[str, bool]:
    """Returns what the RobotApp asks of its places as sentences, and whether it holds with these nodes."""
    promises = {}
    for component in app["spec"]["components"]:
        name = component["name"]
        node = topology.nodes.get(nodes.get(name, ""))
        promises[f"{name} has a node"] = node is not None
        if "runsOn" in component:
            promises[f"{name} is on {' or '.join(component['runsOn'])}"] = (
                node is not None and node.tier.capitalize() in component["runsOn"]
            )
        for device in component.get("devices", []):
            promises[f"{name} is where a {device['type']} is"] = node is not None and device["type"] in {
                item.type for item in node.devices
            }
        if component.get("sharedData"):
            promises[f"{name} is where its volume is"] = node is not None and node.name == scenario.volume_node
    return promises | _list_budgets(app, nodes, topology) | _list_zones(app, nodes, topology)


def _list_budgets(app: Json, nodes: Mapping[str, str], topology: Topology) -> dict[str, bool]:
    promises = {}
    for connection in app["spec"].get("edges", []):
        budget, ends = connection.get("latency", {}).get("budget"), sorted((connection["from"], connection["to"]))
        if budget is None:
            continue
        places = [nodes.get(end, "") for end in ends]
        are_placed = all(place in topology.nodes for place in places)
        promises[f"{ends[0]} and {ends[1]} are within {budget}"] = are_placed and topology.rtt_ms(
            *places
        ) * 1000 <= parse_us(budget)
    return promises


def _list_zones(app: Json, nodes: Mapping[str, str], topology: Topology) -> dict[str, bool]:
    """Returns whether components are in the preferred zone. Those of robots may not be in it, so they are left out."""
    zones = app["spec"].get("placement", {}).get("zones", [])
    promises = {}
    for component in app["spec"]["components"] if zones else []:
        is_bound = "Robot" in component.get("runsOn", []) or "nodeSelector" in str(component.get("template", {}))
        node = topology.nodes.get(nodes.get(component["name"], ""))
        if not is_bound:
            promises[f"{component['name']} is in {zones[0]}"] = node is not None and node.zone == zones[0]
    return promises


def describe_decision(record: Json) -> list[str]:
    """Returns what refused nodes, by plugin, and what made the chosen node better than the next one."""
    lines = []
    for refusal in record.get("refusals") or []:
        reasons = describe_refusals({**record, "refusals": [refusal]}, ())
        lines.append(f"{refusal['plugin']} refuses {'; '.join(reasons)}")
    top = record.get("top") or {}
    if len(top.get("nodes") or ()) > 1:
        better = [
            f"{name} {chosen_score}:{next_score}" for name, (chosen_score, next_score) in _list_differences(top).items()
        ]
        lines.append(f"{top['nodes'][0]} before {top['nodes'][1]} by {', '.join(better) or 'the tie-break'}")
    return lines


def list_plugins(record: Json) -> set[str]:
    """Returns the plugins that refused a node, or whose scores differ between the chosen node and the next one."""
    return {str(refusal["plugin"]) for refusal in record.get("refusals") or []} | set(
        _list_differences(record.get("top") or {})
    )


def _list_differences(top: Json) -> dict[str, tuple[int, int]]:
    scores = {name: values for name, values in (top.get("scores") or {}).items() if len(values) > 1}
    weighted_scores = {name: values for name, values in scores.items() if (top.get("weights") or {}).get(name)}
    return {name: (values[0], values[1]) for name, values in weighted_scores.items() if values[0] != values[1]}


def find_scenario(app: str) -> Scenario:
    """Returns the scenario of an application by the name of its folder."""
    return SCENARIOS[app.rpartition("-ros")[0]]
