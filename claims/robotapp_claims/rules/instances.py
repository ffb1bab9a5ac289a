"""Which instances of an app exist: one in all, one per robot, one for any robot, or one per combination of a matrix.

One rule for the operator, which reads caches, and the sweep, which reads afresh: an instance that exists for
one and not for the other would be created and freed in turn.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.selector import matches_labels
from robotapp_api.values.sweeps.matrix import expand_matrix
from robotapp_claims.rules.identity import hash10
from robotapp_claims.rules.objects import App, Meta

ANY: Final = "Any"
FEW_MISSING: Final = 3
"""So many robots may end at once because of their nodes, or a tenth of all if that is more."""
_NAMED: Final = 4
"""Nodes a message names."""
PRIMARY: Final = "true"
"""Value of Label.ROBOT_PRIMARY on the one node of a robot that is `@robot`."""


class Labelled(Protocol):
    """A node, wherever it is kept."""

    @property
    def name(self) -> str: ...
    @property
    def labels(self) -> Mapping[str, str]: ...


@dataclass(frozen=True, slots=True)
class Primary:
    """Which node of a robot is the robot's node (`@robot`): its name, or "" and the problem with its cure."""

    node: str = ""
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Instance:
    """`robot` is the instance's key ("" for an app without robots, for one with a matrix the name of the combination), `node` the
    robot's primary node.

    problem: why no node of the robot is its primary one, and what to label; `node` is "" then. The instance exists all the
    same: what runs goes on running, and whether a new one starts is for the caller to decide.
    missing: no node of the robot matches any more, and the instance goes on all the same (`out_of_sight`).
    """

    robot: str = ""
    node: str = ""
    problem: str = ""
    missing: bool = False


@dataclass(frozen=True, slots=True)
class RobotSelection:
    """An app's spec.robots and spec.matrix. node_selector is metav1.LabelSelector as plain JSON, None for an app without robots.

    combinations: names of the instances of its matrix, None without one.
    """

    uid: str
    namespace: str
    node_selector: Mapping[str, Any] | None = None
    assignment: str = "Each"
    combinations: tuple[str, ...] | None = None


def robot_selection_of(app: App) -> RobotSelection:
    robots, meta = app.spec.robots, app.metadata
    if app.spec.matrix is not None:
        return RobotSelection(meta.uid, meta.namespace, combinations=list_combinations(app.spec.matrix))
    if robots is None:
        return RobotSelection(meta.uid, meta.namespace)
    return RobotSelection(meta.uid, meta.namespace, robots.node_selector, robots.assignment)


def list_combinations(matrix: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the names of the instances of a matrix, in the order of its values."""
    return tuple(instance.name for instance in expand_matrix(matrix))


def instances_of(
    selection: RobotSelection,
    nodes: Iterable[Meta],
    *,
    running: Collection[str],
    claimed: Collection[str],
    unreachable: Collection[str] = (),
    kept: Collection[str] = (),
) -> tuple[Instance, ...]:
    """Instances in name order. running: instance keys of the app's Deployments, claimed: of its claims.

    nodes: those of all robots, because a robot's primary node may be one that the selector does not name.
    `Any` stays where it runs, else where it has claims, however reachable that robot is; else it takes one within reach
    (unreachable: names of nodes) whose primary node is known, spread over the robots by hash instead of always taking the
    first name. kept: those robots out of sight whose instances go on.
    """
    if selection.combinations is not None:
        return tuple(map(Instance, sorted(selection.combinations)))
    if selection.node_selector is None:
        return (Instance(),)
    nodes = list(nodes)
    found = _instances({robot_of(node) for node in allowed_robots(selection, nodes)}, nodes)
    found = {robot: Instance(robot, missing=True) for robot in kept} | found
    if selection.assignment != ANY or not found:
        return tuple(found[robot] for robot in sorted(found))
    recorded = found.keys() & {*running, *claimed}
    chosen = min(
        recorded or found.keys(),
        key=lambda robot: (
            robot not in running,
            not recorded and bool(found[robot].problem),
            not recorded and found[robot].node in unreachable,
            hash10(f"{selection.uid}/{robot}"),
        ),
    )
    return (found[chosen],)


def out_of_sight(selection: RobotSelection, nodes: Iterable[Meta], *, running: Collection[str]) -> frozenset[str]:
    """Robots the app runs on of which no node matches its selector: the Node or its labels are gone.

    That alone proves nothing: a Node is deleted and joins again, a tool takes labels off by mistake, and the robot drives
    on. A robot that is there and does not admit the app's namespace is none of these: its administrator has decided that.
    """
    if selection.node_selector is None:
        return frozenset()
    return frozenset(running) - {robot_of(node) for node in matching_robots(selection, nodes)} - {""}


def too_many_missing(holding: Collection[str], present: Collection[str]) -> bool:
    """Whether so many robots are without a node that a mistake is likelier than that they left: no instance ends meanwhile.

    holding: robots with Deployments or claims. present: robots with a node. Both are levels, so that a restart of the
    program that decides forgets nothing.
    """
    missing = len(set(holding) - set(present))
    return are_many(missing, len(holding)) or 2 <= missing == len(holding)


def are_many(missing: int, of: int) -> bool:
    """More than three and more than a tenth."""
    return 10 * missing > max(10 * FEW_MISSING, of)


def _instances(robots: Collection[str], nodes: Iterable[Meta]) -> dict[str, Instance]:
    computers: dict[str, list[Meta]] = {robot: [] for robot in robots}
    for node in nodes:
        if (robot := robot_of(node)) in computers:
            computers[robot].append(node)
    primaries = {robot: primary_node(robot, found) for robot, found in computers.items()}
    return {robot: Instance(robot, primary.node, primary.problem) for robot, primary in primaries.items()}


def primary_node(robot: str, nodes: Iterable[Labelled]) -> Primary:
    """The robot's node. nodes: all nodes of this robot and no others.

    A robot's only node is its primary one, whatever its labels. Of several it is the one labelled Label.ROBOT_PRIMARY; a
    guess (the first name, say) would move latency budgets and devices to another computer when a node joins the robot.
    """
    computers = {node.name: node.labels.get(Label.ROBOT_PRIMARY) == PRIMARY for node in nodes}
    primaries = sorted(name for name, primary in computers.items() if primary)
    if len(computers) == 1:
        return Primary(next(iter(computers)))
    if len(primaries) == 1:
        return Primary(primaries[0])
    if not computers:
        return Primary("", f"robot {robot} has no node: label its computer {Label.ROBOT}={robot}")
    names = _listed(sorted(computers))
    label = f"{Label.ROBOT_PRIMARY}={PRIMARY}"
    if not primaries:
        return Primary(
            "",
            f"robot {robot} has {len(computers)} nodes ({names}) and none is labelled {label}: label the one that `@robot` means",
        )
    return Primary(
        "",
        f"robot {robot} has {len(primaries)} nodes labelled {label} ({_listed(primaries)}): leave the label on one of them",
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def matching_robots(selection: RobotSelection, nodes: Iterable[Meta]) -> list[Meta]:
    """Robot nodes the selector names, in name order, allowed or not."""
    found = (node for node in nodes if robot_of(node) and matches_labels(selection.node_selector, node.labels))
    return sorted(found, key=lambda node: node.name)


def allowed_robots(selection: RobotSelection, nodes: Iterable[Meta]) -> list[Meta]:
    """Nodes that the selector names, of robots that admit the app's namespace. nodes: all computers of every robot."""
    return matching_robots(selection, open_robots(nodes, selection.namespace))


def open_robots(nodes: Iterable[Meta], namespace: str) -> list[Meta]:
    """Computers of the robots that admit the namespace."""
    nodes = [node for node in nodes if robot_of(node)]
    closed = closed_nodes(nodes, namespace)
    return [node for node in nodes if node.name not in closed]


def closed_nodes(nodes: Collection[Meta], namespace: str) -> frozenset[str]:
    """Names of the nodes that do not admit the namespace (node annotation robotics.io/allowed-namespaces).

    A robot admits it only if each of its computers does: else pods would get on the robot through a computer without
    the annotation. nodes: all computers of each robot among them.
    """
    refusing = [node for node in nodes if not admits(node.annotations, namespace)]
    robots = {robot_of(node) for node in refusing} - {""}
    return frozenset(node.name for node in (*refusing, *(node for node in nodes if robot_of(node) in robots)))


def robot_of(node: Meta) -> str:
    """Name of the robot a node is on, "" for other nodes."""
    return node.labels.get(Label.ROBOT, "")


def admitted(allowed: str | None) -> frozenset[str] | None:
    """Namespaces that a node's annotation robotics.io/allowed-namespaces names; None without it: it admits every one."""
    return None if allowed is None else frozenset(name.strip() for name in allowed.split(",") if name.strip())


def admits(annotations: Mapping[str, str], namespace: str) -> bool:
    """Whether this node admits the namespace. A robot does only if each of its computers does (`closed_nodes`)."""
    names = admitted(annotations.get(Annotation.ALLOWED_NAMESPACES))
    return names is None or namespace in names
