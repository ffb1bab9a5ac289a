"""A launch file as a RobotApp: its nodes as components, their edges and devices. Images are left to the user."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import yaml

from ros_profile.model.conclusions import Assessment, Edge, Hardware, LaunchedNode, LaunchProfile, QosClass
from ros_profile.model.endpoints import Qos
from ros_profile.output.hardware import EXCLUSIVE_TYPES, devices_and_requires
from ros_profile.output.names import (
    API_VERSION,
    MAX_APP_NAME,
    MAX_COMPONENTS,
    MAX_EDGES,
    ROS1_DISTROS,
)
from ros_profile.output.values import TIERS, bits, distinct, duration, library, perhaps, policies, requirement

IMAGE: Final = "example.invalid/give-me-an-image:tag"
MAX_ARGUMENTS: Final = 50
_CAMEL: Final = {"qos_class": "qosClass", "latency_budget": "latencyBudget", "deadline": "deadline"}
_TOPIC: Final = re.compile(r"/[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_TYPE: Final = re.compile(r"[a-zA-Z]\w*/(?:(?:msg|srv|action)/)?[A-Z]\w*", re.ASCII)
_TOOLS: Final = frozenset({"rviz2", "rviz", "rqt_gui", "rqt_graph", "rqt_reconfigure"})
_ENDING: Final = frozenset({"create", "spawn_entity.py", "spawn_model", "spawner.py", "unspawner", "unspawner.py"})
"""Programs that end when their work is done; what a RobotApp starts is started again and again."""
_NETWORKS: Final = frozenset({"tcp", "udp", "ethernet", "network"})
_CHANNEL: Final = re.compile(r"channel|comm|connection|transport|protocol|interface")
_SPAWNER: Final = ("controller_manager", "spawner")


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
    spec: dict[str, Any] = {
        "ros": {"distro": distro},
        "components": [_component(one, ros1=distro in ROS1_DISTROS) for one in found],
    }
    if drawn := _edges(launch.edges, found):
        spec["edges"] = drawn
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": _label(name)[:MAX_APP_NAME].strip("-")},
        "spec": spec,
    }


def as_robotapp(launch: LaunchProfile, *, name: str, distro: str) -> str:
    """The RobotApp as YAML, with what was left out as comments."""
    body = yaml.safe_dump(app(launch, name=name, distro=distro), sort_keys=False, allow_unicode=True, width=120)
    return "".join(_comments(launch)) + body


def _component(component: Component, *, ros1: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"name": component.name, "image": IMAGE, "args": _arguments(component, ros1=ros1)}
    hardware = dict.fromkeys(one for node in component.nodes for one in _opened(node))
    return {**found, **needs(_lead(component).assessment, hardware)}


def _opened(node: LaunchedNode) -> list[Hardware]:
    """The hardware of a node, without a serial line that its parameters replace by the network."""
    found = distinct(node.assessment.hardware)
    return [one for one in found if one.type != "serial"] if _network(node) else found


def _network(node: LaunchedNode) -> str:
    """The parameter by which a driver that also takes a serial line goes over the network, such as `channel_type:=tcp`; "" without."""
    pairs = ((key, value) for key, value in node.parameters if value.lower() in _NETWORKS)
    return next((f"{key}:={value}" for key, value in pairs if _CHANNEL.search(key)), "")


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
    return {**found, **devices_and_requires(_stated(one) for one in hardware)}


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


def _arguments(component: Component, *, ros1: bool) -> list[str]:
    """How the process is started. Where a parameter file lies in the image is not known: comments name these files."""
    plain = next((node for node in component.nodes if not node.plugin), None)
    alone = component.nodes[0] if len(component.nodes) == 1 else None
    if ros1:
        node = plain or component.nodes[0]
        words = (
            ["rosrun", node.package, node.executable]
            if plain
            else ["rosrun", "nodelet", "nodelet", "standalone", node.plugin]
        )
        return (
            words
            + _own_arguments(node, node.arguments)
            + [f"{key}:={value}" for _, key, value in _options(node, "__name", "_")]
        )
    if plain is None and alone is not None:
        return ["ros2", "component", "standalone", alone.package, alone.plugin, *_flags(alone)]
    if plain is None:
        return ["ros2", "run", "rclcpp_components", "component_container"]
    more = _flags(plain)
    own = _own_arguments(plain, _with_flag(plain))
    return ["ros2", "run", plain.package, plain.executable, *own, *(["--ros-args", *more] if more else [])]


def _with_flag(node: LaunchedNode) -> list[str]:
    """The arguments; a spawner stays until it is stopped. Without the flag it ends, and its pod would crash and crash."""
    own = list(node.arguments)
    spawns = (node.package, node.executable) == _SPAWNER and any(own)
    return [*own, "--unload-on-kill"] if spawns and "--unload-on-kill" not in own else own


def _own_arguments(node: LaunchedNode, arguments: Iterable[str]) -> list[str]:
    """All of them or none: half a command line may mean something else. A comment has what cannot be told."""
    return [] if _is_untold(node) else [text for text in arguments if text]


def _is_untold(node: LaunchedNode) -> bool:
    return len(node.arguments) > MAX_ARGUMENTS or any("$" in text or len(text) > 1000 for text in node.arguments)


def _flags(node: LaunchedNode) -> list[str]:
    return [word for flag, key, value in _options(node, "__node") for word in (flag, f"{key}:={value}")]


def _options(node: LaunchedNode, name_key: str, prefix: str = "") -> list[tuple[str, str, str]]:
    """(flag of ROS 2, key, value) of the node's name, namespace, remaps and parameters; what is not known is left out."""
    name = node.full_name.rpartition("/")[2]
    found = [("-r", name_key, name)] if name != node.executable else []
    if node.namespace not in ("", "/"):
        found.append(("-r", "__ns", node.namespace))
    stated = set(node.arguments)
    found += [("-r", *pair) for pair in node.remaps if all(pair) and ":=".join(pair) not in stated]
    found += [("-p", f"{prefix}{key}", value) for key, value in node.parameters if value and len(value) < 200]
    return [one for one in found if "$" not in one[1] + one[2] and "\n" not in one[2]][:50]


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


def _comments(launch: LaunchProfile) -> list[str]:
    lines = [
        f"# Inferred from {launch.package}/{launch.file}. Give every component its image; check runsOn and devices.\n"
    ]
    found = components(launch.nodes)
    lines += _doubts(found)
    for component in found:
        if len(component.nodes) > 1 and any(node.plugin for node in component.nodes):
            plugins = ", ".join(node.plugin for node in component.nodes if node.plugin)
            lines.append(f"# {component.name} is one process; load into it: {plugins[:500]}\n")
        lines += [
            f"# {component.name}: perhaps {perhaps(one)}: left out\n"
            for node in component.nodes
            for one in node.assessment.doubted
        ]
        lines += [
            f"# {component.name}: {requirement(one)['type']} is opened through {library(one)}\n"
            for node in component.nodes
            for one in _opened(node)
            if library(one)
        ]
        lines += [
            f"# {component.name}: no serial device, because of {network}\n"
            for node in component.nodes
            if (network := _network(node)) and len(_opened(node)) < len(distinct(node.assessment.hardware))
        ]
        lines += [
            f"# {component.name}: is started with arguments that the launch file works out; add them to args: "
            f"{' '.join(_with_flag(node))[:300]}\n"
            for node in component.nodes
            if _is_untold(node)
        ]
        lines += [f"# {component.name}: {text}\n" for node in component.nodes for text in _worked_out(node)]
        lines += [
            f"# {component.name}: parameters of {_file_name(f)}\n"
            for node in component.nodes
            for f in node.parameter_files
        ]
    lines += [
        f"# {node.executable} of {node.package} ends by itself and is left out: a RobotApp would start it again and again\n"
        for node in launch.nodes
        if node.executable in _ENDING
    ]
    lines += [f"# {problem.file}: {problem.message[:300]}\n" for problem in launch.problems]
    return [line.replace("\r", " ") for line in dict.fromkeys(" ".join(line.split()) + "\n" for line in lines)]


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
