"""The cluster's nodes, with version numbers for values computed from all of them."""

from collections.abc import Iterator, MutableMapping

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.objects import Node


class Nodes(MutableMapping[str, Node]):
    """Nodes by name.

    `identity_version` counts up when a node is added or removed, or when its labels or the namespaces it admits change.
    `readiness_version` counts up when a node becomes ready or unready. Heartbeats change neither.
    """

    def __init__(self) -> None:
        self._nodes: dict[str, Node] = {}
        self._of_robot: dict[str, set[str]] = {}
        self.identity_version = 0
        self.readiness_version = 0

    def __repr__(self) -> str:
        return f"<Nodes: {len(self._nodes)}, version {self.identity_version}.{self.readiness_version}>"

    def __getitem__(self, name: str) -> Node:
        return self._nodes[name]

    def __setitem__(self, name: str, node: Node) -> None:
        before = self._nodes.get(name)
        self._nodes[name] = node
        if before is not None and before.robot != node.robot:
            self._leave(name, before.robot)
        if node.robot:
            self._of_robot.setdefault(node.robot, set()).add(name)
        if before is None or identity_changed(before, node):
            self.identity_version += 1
        if before is None or before.ready != node.ready:
            self.readiness_version += 1

    def __delitem__(self, name: str) -> None:
        self._leave(name, self._nodes.pop(name).robot)
        self.identity_version += 1
        self.readiness_version += 1

    def __iter__(self) -> Iterator[str]:
        return iter(self._nodes)

    def __len__(self) -> int:
        return len(self._nodes)

    @property
    def robots(self) -> set[str]:
        """Robots that have a node."""
        return set(self._of_robot)

    def of_robot(self, robot: str) -> frozenset[str]:
        """Names of the nodes that are computers of `robot`."""
        return frozenset(self._of_robot.get(robot, ()))

    def _leave(self, name: str, robot: str) -> None:
        members = self._of_robot.get(robot, set())
        members.discard(name)
        if not members:
            self._of_robot.pop(robot, None)


def identity_changed(before: Node, now: Node) -> bool:
    """Did the node's labels change, or the namespaces it admits?"""
    allowed = Annotation.ALLOWED_NAMESPACES
    one, other = before.metadata, now.metadata
    return one.labels != other.labels or one.annotations.get(allowed) != other.annotations.get(allowed)
