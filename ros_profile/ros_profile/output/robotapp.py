"""A launch file as a RobotApp: its nodes as components, their edges and devices. Images are left to the user."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import yaml

from ros_profile.decide.transport import network_setting
from ros_profile.model.conclusions import Assessment, Edge, Hardware, LaunchedNode, LaunchProfile, QosClass
from ros_profile.model.endpoints import Qos
from ros_profile.output.commands import absolute_files, complete_arguments, is_untold, ros1_words, ros2_words
from ros_profile.output.hardware import CLAIMED_TYPES, EXCLUSIVE_TYPES, devices_and_requires
from ros_profile.output.names import (
    API_VERSION,
    MAX_APP_NAME,
    MAX_COMPONENTS,
    MAX_EDGES,
    ROS1_DISTROS,
)
from ros_profile.output.values import (
    TIERS,
    bits,
    claimable,
    distinct,
    duration,
    library,
    perhaps,
    policies,
    requirement,
    unclaimed,
)

IMAGE: Final = "example.invalid/give-me-an-image:tag"
_CAMEL: Final = {"qos_class": "qosClass", "latency_budget": "latencyBudget", "deadline": "deadline"}
_TOPIC: Final = re.compile(r"/[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_TYPE: Final = re.compile(r"[a-zA-Z]\w*/(?:(?:msg|srv|action)/)?[A-Z]\w*", re.ASCII)
_TOOLS: Final = frozenset({"rviz2", "rviz", "rqt_gui", "rqt_graph", "rqt_reconfigure"})
_ENDING: Final = frozenset({"create", "spawn_entity.py", "spawn_model", "spawner.py", "unspawner", "unspawner.py"})
"""Programs that end when their work is done; what a RobotApp starts is started again and again."""
_VARIABLE: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,100}", re.ASCII)
_OWN_VARIABLES: Final = frozenset({"ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "ROS_MASTER_URI", "ROS_IP", "ROS_HOSTNAME"})
"""What the operator sets, from spec.ros2 and spec.ros1."""
MAX_INLINE_BYTES: Final = 180_000
"""Of the parameter files in one app, which also travel in annotations of its pods."""
MAX_FILES: Final = 16


@dataclass(frozen=True, slots=True)
class Component:
    """One process: a node, or a container with the nodes loaded into it."""

    name: str
    nodes: tuple[LaunchedNode, ...]


def components(nodes: Iterable[LaunchedNode]) -> list[Component]:
    """Nodes by process. Viewers stay out, they belong on a desk, and so do programs that end by themselves."""
    groups: dict[str, list[LaunchedNode]] = {}
    twins: Counter[str] = Counter()
    for node in nodes:
        if node.executable in _TOOLS | _ENDING:
            continue
        key = node.container or node.full_name
        if not node.plugin:  # two nodes without a name are called alike, and are two processes
            twins[key] += 1
            key = key if twins[key] == 1 else f"{key}-{twins[key]}"
        groups.setdefault(key, []).append(node)
    names: dict[str, int] = {}
    found = []
    short = Counter(_label(key.rpartition("/")[2]) for key in groups)
    for key, members in groups.items():
        name = _label(key.rpartition("/")[2])
        if short[name] > 1:
            name = _label(key)
        names[name] = names.get(name, 0) + 1
        found.append(Component(name if names[name] == 1 else f"{name[:58]}-{names[name]}", tuple(members)))
    return found[:MAX_COMPONENTS]


def _label(name: str) -> str:
    cleaned = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    return cleaned[:60].strip("-") or "node"


def app(launch: LaunchProfile, *, name: str, distro: str) -> dict[str, Any]:
    """The RobotApp as plain data."""
    found = components(launch.nodes)
    ros1, texts = distro in ROS1_DISTROS, dict(launch.parameter_texts)
    files = _inline_files(found, texts, ros1=ros1)
    bodies = [_component(one, taken, texts, ros1=ros1) for one, taken in zip(found, files, strict=True)]
    spec: dict[str, Any] = {"ros": {"distro": distro}, "components": bodies}
    if drawn := _edges(launch.edges, found):
        spec["edges"] = drawn
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": _label(name)[:MAX_APP_NAME].strip("-")},
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
    hardware = dict.fromkeys(one for node in nodes for one in _opened(node))
    return {**body, **needs(_lead(component).assessment, hardware)}


def _variables(component: Component) -> dict[str, str]:
    """The environment that the launch file gives, without what the operator sets itself."""
    pairs = (pair for node in component.nodes for pair in node.environment)
    return {
        key: value
        for key, value in pairs
        if key not in _OWN_VARIABLES and _VARIABLE.fullmatch(key) and "$" not in value
    }


def _inline_files(found: Iterable[Component], texts: dict[str, str], *, ros1: bool) -> list[dict[str, int]]:
    """By component the parameter files that it takes over, as far as an app may hold them (one file again and again counts)."""
    remaining = MAX_INLINE_BYTES
    by_component: list[dict[str, int]] = []
    for component in found:
        files: dict[str, int] = {}
        for file in dict.fromkeys(file for node in component.nodes for file in node.parameter_files):
            size = len(texts.get(file, "").encode())
            if ros1 or not size or size > remaining or "$(" in texts[file] or len(files) >= MAX_FILES:
                continue
            remaining -= size
            files[file] = len(files)
        by_component.append(files)
    return by_component


def _opened(node: LaunchedNode) -> list[Hardware]:
    """The hardware of a node, without a serial line that its parameters replace by the network."""
    found = distinct(node.assessment.hardware)
    return [one for one in found if one.type != "serial"] if _network(node) else found


def _network(node: LaunchedNode) -> str:
    """The parameter of the launch file, or of a parameter file, by which a driver goes over the network; "" without."""
    return node.network or network_setting(node.parameters)


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
    lines = [
        f"# Inferred from {launch.package}/{launch.file}. Give every component its image; check runsOn and devices.\n"
    ]
    found = components(launch.nodes)
    lines += _doubts(found)
    taken = _inline_files(found, dict(launch.parameter_texts), ros1=distro in ROS1_DISTROS)
    for component, files in zip(found, taken, strict=True):
        lines += [f"# {component.name}: {text}\n" for text in _component_comments(component, files, distro)]
    lines += [
        f"# {node.executable} of {node.package} ends by itself and is left out: a RobotApp would start it again and again\n"
        for node in launch.nodes
        if node.executable in _ENDING
    ]
    lines += [f"# {problem.file}: {problem.message[:300]}\n" for problem in launch.problems]
    return [line.replace("\r", " ") for line in dict.fromkeys(" ".join(line.split()) + "\n" for line in lines)]


def _component_comments(component: Component, files: Iterable[str], distro: str) -> Iterator[str]:
    """What of a component the reader has to decide about or to add."""
    nodes, taken = component.nodes, frozenset(files)
    yield from (f"perhaps {perhaps(one)}: left out" for node in nodes for one in node.assessment.doubted)
    for node in nodes:
        opened = _opened(node)
        asked = claimable(opened)
        yield from (f"{requirement(one)['type']} is opened through {library(one)}" for one in asked if library(one))
        yield from unclaimed(opened)
        if (network := _network(node)) and len(opened) < len(distinct(node.assessment.hardware)):
            yield f"no serial device, because of {network}"
        if is_untold(node):
            words = " ".join(complete_arguments(node))[:300]
            yield f"is started with arguments that the launch file works out; add them to args: {words}"
        yield from _worked_out(node)
        yield from _started_otherwise(node, ros1=distro in ROS1_DISTROS)
        passed = taken.union(absolute_files(node))
        yield from (f"parameters of {_file_name(file)}" for file in node.parameter_files if file not in passed)


def _started_otherwise(node: LaunchedNode, *, ros1: bool) -> Iterator[str]:
    """What of the way a node is started is not in its command line and variables."""
    if node.prefix and (ros1 or node.plugin or "$" in node.prefix):
        yield f"is started with {node.prefix[:100]} before its program, which is left out"
    for key, value in node.environment:
        if key in _OWN_VARIABLES:
            yield f"variable {key}={value[:100]} is left out, because the operator sets it; write spec.ros{1 if ros1 else 2}"
        elif "$" in value or not _VARIABLE.fullmatch(key):
            yield f"variable {key[:100]} is worked out by the launch file; write it under env"


def _doubts(found: Iterable[Component]) -> Iterator[str]:
    """Components that may not belong: conditions of a launch file often choose one of several drivers."""
    doubtful = [one for one in found if not all(node.certain for node in one.nodes)]
    for one in doubtful:
        yield f"# {one.name}: is started under a condition that the launch file works out; leave it out where it does not hold\n"
    owners: dict[str, list[str]] = {}
    for one in doubtful:
        kinds = {hardware.type for node in one.nodes for hardware in _opened(node)}
        for kind in sorted(kinds & EXCLUSIVE_TYPES):
            owners.setdefault(kind, []).append(one.name)
    for kind, names in owners.items():
        if len(names) > 1:
            yield f"# {', '.join(names)}: each wants a {kind} device for itself, under a condition: keep the one that your robot has\n"


def _worked_out(node: LaunchedNode) -> Iterator[str]:
    """What of a node's start only the launch file knows, and is therefore missing."""
    if "$" in node.namespace:
        yield f"its namespace is worked out by the launch file ({node.namespace[:100]}); add -r __ns:=/… to args where there is one"
    missing = (
        (node.parameters, "parameter", "write it into a parameter file"),
        (node.remaps, "remap", "add it to args"),
    )
    for pairs, what, cure in missing:
        for key, value in pairs:
            if "$" in key + value or "\n" in value:
                yield f"{what} {key[:100]} is worked out by the launch file; {cure}"


def _file_name(file: str) -> str:
    """A parameter file as far as the launch file tells it."""
    return f"a file whose name the launch file works out ({file[:100]})" if re.search(r"[$|?]", file) else file
