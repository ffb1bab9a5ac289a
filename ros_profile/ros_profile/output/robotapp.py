"""A launch file as a RobotApp: its nodes as components, their edges and devices. Images are left to the user."""

import re
from collections.abc import Iterable
from typing import Any, Final

import yaml

from ros_profile.model.conclusions import Assessment, Edge, Hardware, LaunchedNode, LaunchProfile, QosClass
from ros_profile.model.endpoints import Qos
from ros_profile.output.commands import ros1_words, ros2_words
from ros_profile.output.hardware import CLAIMED_TYPES, EXCLUSIVE_TYPES, devices_and_requires
from ros_profile.output.names import (
    API_VERSION,
    MAX_APP_NAME,
    MAX_EDGES,
    ROS1_DISTROS,
)
from ros_profile.output.notes import list_notes
from ros_profile.output.processes import (
    OPERATOR_VARIABLES,
    VARIABLE_NAME,
    Component,
    components,
    inline_files,
    label,
    opened_hardware,
)
from ros_profile.output.values import (
    TIERS,
    bits,
    claimable,
    duration,
    policies,
    requirement,
)

IMAGE: Final = "CHOOSE-AN-IMAGE"
"""The mark that `kubectl robotapp lint` names where a person has to write the image."""
_CAMEL: Final = {"qos_class": "qosClass", "latency_budget": "latencyBudget", "deadline": "deadline"}
_TOPIC: Final = re.compile(r"/[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_TYPE: Final = re.compile(r"[a-zA-Z]\w*/(?:(?:msg|srv|action)/)?[A-Z]\w*", re.ASCII)


def app(launch: LaunchProfile, *, name: str, distro: str) -> dict[str, Any]:
    """The RobotApp as plain data."""
    found = components(launch.nodes)
    ros1, texts = distro in ROS1_DISTROS, dict(launch.parameter_texts)
    files = inline_files(found, texts, ros1=ros1)
    bodies = [_component(one, taken, texts, ros1=ros1) for one, taken in zip(found, files, strict=True)]
    spec: dict[str, Any] = {"ros": {"distro": distro}, "components": bodies}
    if drawn := _edges(launch.edges, found):
        spec["edges"] = drawn
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": label(name)[:MAX_APP_NAME].strip("-")},
        "spec": spec,
    }


class _Dumper(yaml.SafeDumper):
    """Writes scripts and parameter files as blocks of lines."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _represent_text)


def as_robotapp(launch: LaunchProfile, *, name: str, distro: str) -> str:
    """The RobotApp as YAML, with what was left out as comments."""
    body = yaml.dump(
        app(launch, name=name, distro=distro), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120
    )
    return "".join(_comments(launch, distro)) + body


def _component(component: Component, files: dict[str, int], texts: dict[str, str], *, ros1: bool) -> dict[str, Any]:
    """`files`: position in the component's `parameters` by name of the parameter file."""
    nodes = component.nodes
    words = ros1_words(nodes) if ros1 else ros2_words(component.name, nodes, files)
    body: dict[str, Any] = {"name": component.name, "image": IMAGE, "args": words}
    if variables := _variables(component):
        body["env"] = [{"name": key, "value": value} for key, value in variables.items()]
    if files:
        body["parameters"] = [{"inline": texts[file]} for file in files]
    hardware = dict.fromkeys(one for node in nodes for one in opened_hardware(node))
    return {**body, **needs(_lead(component).assessment, hardware)}


def _variables(component: Component) -> dict[str, str]:
    """The environment that the launch file gives, without what the operator sets itself."""
    pairs = (pair for node in component.nodes for pair in node.environment)
    return {
        key: value
        for key, value in pairs
        if key not in OPERATOR_VARIABLES and VARIABLE_NAME.fullmatch(key) and "$" not in value
    }


def needs(assessment: Assessment, hardware: Iterable[Hardware]) -> dict[str, Any]:
    """`runsOn`, `qosClass`, `policies`, `devices` and `requires` of a component, as far as they were concluded."""
    found: dict[str, Any] = {}
    if assessment.placement is not None and assessment.placement.value in TIERS:
        found["runsOn"] = list(TIERS[assessment.placement.value])
    stated = policies(assessment, _CAMEL)
    if qos_class := stated.pop("qosClass", None):
        found["qosClass"] = qos_class
    if stated:
        found["policies"] = stated
    return {**found, **_claims(hardware)}


def _claims(hardware: Iterable[Hardware]) -> dict[str, list[dict[str, str]]]:
    """Devices and requirements; a camera or an input device has the USB id that a udev rule names."""
    kept = list(hardware)
    usb_id = next((one.usb_id for one in kept if one.usb_id and one.type in ("camera", "usb")), "")
    identity = {"usbID": usb_id} if usb_id else {}
    stated = (_stated(one) for one in claimable(kept))
    named = CLAIMED_TYPES - EXCLUSIVE_TYPES
    return devices_and_requires(one | identity if one["type"] in named else one for one in stated)


def _lead(component: Component) -> LaunchedNode:
    """The node whose class is the most demanding: its process gets it."""

    def rank(node: LaunchedNode) -> int:
        estimate = node.assessment.qos_class
        return estimate.value.rank if estimate is not None else len(QosClass)

    return min(component.nodes, key=rank)


def _stated(hardware: Hardware) -> dict[str, str]:
    """`requirement`, and of a device the USB id that a udev rule names."""
    usb = {"usbID": hardware.usb_id} if hardware.usb_id and hardware.type in EXCLUSIVE_TYPES else {}
    return requirement(hardware) | usb


def _edges(edges: Iterable[Edge], found: list[Component]) -> list[dict[str, Any]]:
    """Edges between processes; those within one need no network."""
    by_node = {node.full_name: component for component in found for node in component.nodes}
    drawn: dict[tuple[str, str, str, str], dict[str, Any]] = {}
    for edge in edges:
        source, target = by_node.get(edge.source), by_node.get(edge.target)
        if source is None or target is None or source is target or not _TOPIC.fullmatch(edge.topic):
            continue
        key = (edge.kind, edge.topic, source.name, target.name)
        if key not in drawn and len(drawn) < MAX_EDGES:
            drawn[key] = _edge(edge, source, target)
    return _consistent(list(drawn.values()))


def _edge(edge: Edge, source: Component, target: Component) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": edge.kind, "topic": edge.topic, "from": source.name, "to": target.name}
    if _TYPE.fullmatch(edge.type):
        found["type"] = edge.type
    if edge.kind == "Topic" and (offered := _qos(edge.qos)):
        found["qos"] = offered
    if edge.kind == "Topic" and (asked := _qos(edge.requested_qos)):
        found["requestedQos"] = asked
    lead = _lead(target).assessment
    budget = lead.latency_budget_s
    if budget is not None and lead.qos_class is not None and lead.qos_class.value is QosClass.REALTIME:
        found["latency"] = {"budget": duration(budget.value), "enforce": "Preferred"}
    bandwidth = _lead(source).assessment.bandwidth_bps
    if edge.kind == "Topic" and bandwidth is not None and re.search(r"Image|PointCloud", edge.type):
        found["bandwidth"] = bits(bandwidth.value)
    return found


def _qos(qos: Qos | None) -> dict[str, Any]:
    """What is stated, in the words of the API."""
    if qos is None:
        return {}
    found: dict[str, Any] = {}
    if qos.reliability in ("reliable", "best_effort"):
        found["reliability"] = qos.reliability
    if qos.durability in ("volatile", "transient_local"):
        found["durability"] = qos.durability
    if qos.history in ("keep_last", "keep_all"):
        found["history"] = qos.history
    if 0 <= qos.depth <= 100_000:
        found["depth"] = qos.depth
    return found


def _consistent(drawn: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One offer per topic and sender, as the operator wants it: the first one stands."""
    offers: dict[tuple[str, str, str], Any] = {}
    for edge in drawn:
        key = (edge["kind"], edge["topic"], edge["from"])
        offer = offers.setdefault(key, edge.get("qos"))
        edge.pop("qos", None)
        if offer:
            edge["qos"] = offer
    return drawn


def _comments(launch: LaunchProfile, distro: str) -> list[str]:
    first = f"Inferred from {launch.package}/{launch.file}. Give every component its image; check runsOn and devices."
    texts = [first, *(str(note) for note in list_notes(launch, distro))]
    return list(dict.fromkeys(f"# {' '.join(text.split())}\n" for text in texts))
