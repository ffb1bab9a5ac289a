"""Which instances an app has: one, one per robot, or one on a robot of our choice."""

import dataclasses
import hashlib
from collections.abc import Collection, Mapping

from robotapp_api.model.base import dump
from robotapp_api.model.names import Annotation
from robotapp_api.values.selector import matches_labels
from robotapp_operator.plan.objects import Node
from robotapp_operator.plan.wish import App


@dataclasses.dataclass(frozen=True, slots=True)
class Instance:
    """`robot` is the instance's key ("" for an app without robots), `node` the robot's node."""

    robot: str = ""
    node: str = ""


def instances_of(app: App, nodes: Mapping[str, Node], *, recorded: Collection[str]) -> tuple[Instance, ...]:
    """Instances in name order. `recorded`: instance keys of the app's claims and children; `Any` stays where it is."""
    robots = app.spec.robots
    if robots is None:
        return (Instance(),)
    candidates = allowed_robots(app, nodes)
    if robots.instances == "Any" and candidates:
        chosen = min(candidates, key=lambda node: _preference(app, node, recorded))
        return (Instance(chosen.robot, chosen.metadata.name),)
    found = {node.robot: Instance(node.robot, node.metadata.name) for node in candidates}
    return tuple(found[robot] for robot in sorted(found))


def matching_robots(app: App, nodes: Mapping[str, Node]) -> list[Node]:
    """Robot nodes the selector names, in name order, allowed or not."""
    robots = app.spec.robots
    if robots is None:
        return []
    selector = dump(robots.selector)
    found = (node for node in nodes.values() if node.robot and matches_labels(selector, node.metadata.labels))
    return sorted(found, key=lambda node: node.metadata.name)


def allowed_robots(app: App, nodes: Mapping[str, Node]) -> list[Node]:
    """Matching robots that admit the app's namespace."""
    return [node for node in matching_robots(app, nodes) if admits(node, app.namespace)]


def admits(node: Node, namespace: str) -> bool:
    """A robot without the annotation admits every namespace."""
    allowed = node.metadata.annotations.get(Annotation.ALLOWED_NAMESPACES)
    return allowed is None or namespace in split_names(allowed)


def split_names(text: str) -> list[str]:
    return [name for name in (part.strip() for part in text.split(",")) if name]


def _preference(app: App, node: Node, recorded: Collection[str]) -> tuple[bool, bool, str, str]:
    """Recorded first, then reachable, then spread over the robots by hash instead of always taking the first name."""
    spread = hashlib.sha256(f"{app.uid}/{node.robot}".encode()).hexdigest()
    return (node.robot not in recorded, not node.ready, spread, node.metadata.name)
