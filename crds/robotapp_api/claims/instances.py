"""Which instances of an app exist: one in all, one per robot, or one for any robot.

One rule for everybody who asks, the operator from its caches and the sweep from fresh reads: an instance that exists for
one and not for the other would be created and freed in turn.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from robotapp_api.claims.identity import hash10
from robotapp_api.claims.objects import App, Meta
from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.selector import matches_labels

ANY: Final = "Any"


@dataclass(frozen=True, slots=True)
class Instance:
    """`robot` is the instance's key ("" for an app without robots), `node` the robot's node."""

    robot: str = ""
    node: str = ""


@dataclass(frozen=True, slots=True)
class RobotWish:
    """What an app says about robots: selector is metav1.LabelSelector as plain JSON, None for an app without robots."""

    uid: str
    namespace: str
    selector: Mapping[str, Any] | None = None
    instances: str = "Each"


def wish_of(app: App) -> RobotWish:
    robots, meta = app.spec.robots, app.metadata
    if robots is None:
        return RobotWish(meta.uid, meta.namespace)
    return RobotWish(meta.uid, meta.namespace, robots.selector, robots.instances)


def instances_of(
    wish: RobotWish,
    nodes: Iterable[Meta],
    *,
    running: Collection[str],
    claimed: Collection[str],
    unreachable: Collection[str] = (),
) -> tuple[Instance, ...]:
    """Instances in name order. running: instance keys of the app's Deployments, claimed: of its claims.

    `Any` stays where it runs, else where it has claims, however reachable that robot is; else it takes one within reach
    (unreachable: names of nodes), spread over the robots by hash instead of always taking the first name.
    """
    if wish.selector is None:
        return (Instance(),)
    found: dict[str, Instance] = {}
    for node in allowed_robots(wish, nodes):
        found.setdefault(robot_of(node), Instance(robot_of(node), node.name))
    if wish.instances != ANY or not found:
        return tuple(found[robot] for robot in sorted(found))
    recorded = found.keys() & {*running, *claimed}
    chosen = min(
        recorded or found.keys(),
        key=lambda robot: (
            robot not in running,
            not recorded and found[robot].node in unreachable,
            hash10(f"{wish.uid}/{robot}"),
        ),
    )
    return (found[chosen],)


def matching_robots(wish: RobotWish, nodes: Iterable[Meta]) -> list[Meta]:
    """Robot nodes the selector names, in name order, allowed or not."""
    found = (node for node in nodes if robot_of(node) and matches_labels(wish.selector, node.labels))
    return sorted(found, key=lambda node: node.name)


def allowed_robots(wish: RobotWish, nodes: Iterable[Meta]) -> list[Meta]:
    """Matching robots that admit the app's namespace."""
    return [node for node in matching_robots(wish, nodes) if admits(node, wish.namespace)]


def robot_of(node: Meta) -> str:
    """Name of the robot a node is on, "" for other nodes."""
    return node.labels.get(Label.ROBOT, "")


def admits(node: Meta, namespace: str) -> bool:
    """A robot without the annotation admits every namespace, one with an empty list none."""
    allowed = node.annotations.get(Annotation.ALLOWED_NAMESPACES)
    return allowed is None or namespace in (name.strip() for name in allowed.split(",") if name.strip())
