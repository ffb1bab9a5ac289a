"""The processes of a launch file: which nodes become components of a RobotApp, and what of their surroundings fits into it."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from ros_profile.decide.transport import network_setting
from ros_profile.model.conclusions import Hardware, LaunchedNode
from ros_profile.output.names import MAX_COMPONENTS
from ros_profile.output.values import distinct

VIEWERS: Final = frozenset({"rviz2", "rviz", "rqt_gui", "rqt_graph", "rqt_reconfigure"})
"""Programs with a window: they belong on a desk."""
ENDING: Final = frozenset({"create", "spawn_entity.py", "spawn_model", "spawner.py", "unspawner", "unspawner.py"})
"""Programs that end when their work is done; what a RobotApp starts is started again and again."""
VARIABLE_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,100}", re.ASCII)
OPERATOR_VARIABLES: Final = frozenset(
    {"ROS_DOMAIN_ID", "RMW_IMPLEMENTATION", "ROS_MASTER_URI", "ROS_IP", "ROS_HOSTNAME"}
)
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
    """Returns the nodes by process, as many as an app may have. Viewers stay out, and programs that end by themselves."""
    return list_processes(nodes)[:MAX_COMPONENTS]


def list_processes(nodes: Iterable[LaunchedNode]) -> list[Component]:
    """Returns the nodes by process, without viewers and programs that end by themselves."""
    groups = _group_by_process(node for node in nodes if node.executable not in VIEWERS | ENDING)
    counts: Counter[str] = Counter()
    processes = []
    short_names = Counter(label(key.rpartition("/")[2]) for key in groups)
    for key, members in groups.items():
        name = label(key.rpartition("/")[2])
        if short_names[name] > 1:
            name = label(key)
        counts[name] += 1
        processes.append(Component(name if counts[name] == 1 else f"{name[:58]}-{counts[name]}", tuple(members)))
    return processes


def _group_by_process(nodes: Iterable[LaunchedNode]) -> dict[str, list[LaunchedNode]]:
    groups: dict[str, list[LaunchedNode]] = {}
    twins: Counter[str] = Counter()
    for node in nodes:
        key = node.container or node.full_name
        if not node.plugin:  # two nodes without a name are called alike, and are two processes
            twins[key] += 1
            key = key if twins[key] == 1 else f"{key}-{twins[key]}"
        groups.setdefault(key, []).append(node)
    return groups


def label(name: str) -> str:
    """Returns a name of the graph as a DNS label."""
    cleaned = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    return cleaned[:60].strip("-") or "node"


def inline_files(processes: Iterable[Component], texts: dict[str, str], *, ros1: bool) -> list[dict[str, int]]:
    """Returns by component the parameter files that it takes over, as far as an app may hold them (one file again and again counts)."""
    remaining = MAX_INLINE_BYTES
    by_component: list[dict[str, int]] = []
    for component in processes:
        files: dict[str, int] = {}
        for file in dict.fromkeys(file for node in component.nodes for file in node.parameter_files):
            size = len(texts.get(file, "").encode())
            if ros1 or not size or size > remaining or "$(" in texts[file] or len(files) >= MAX_FILES:
                continue
            remaining -= size
            files[file] = len(files)
        by_component.append(files)
    return by_component


def opened_hardware(node: LaunchedNode) -> list[Hardware]:
    """Returns the hardware of a node, without a serial line that its parameters replace by the network."""
    hardware = distinct(node.assessment.hardware)
    return [one for one in hardware if one.type != "serial"] if network_of(node) else hardware


def network_of(node: LaunchedNode) -> str:
    """Returns the parameter of the launch file, or of a parameter file, by which a driver goes over the network; "" without."""
    return node.network or network_setting(node.parameters)
