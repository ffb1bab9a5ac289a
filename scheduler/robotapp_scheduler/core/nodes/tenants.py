"""Which namespaces nodes admit: the node annotation robotics.io/allowed-namespaces, which holds for the whole robot."""

from collections.abc import Iterable, Mapping

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.instances import admitted


class Tenants:
    """Nodes that restrict the namespaces which may use them, kept up to date node by node.

    A robot of several computers admits a namespace only if each of its computers does: else a pod would get on the robot
    through the one without the annotation.
    """

    def __init__(self) -> None:
        self._allowed: dict[str, frozenset[str]] = {}
        """Admitted namespaces of nodes that have the annotation."""
        self._robot_of: dict[str, str] = {}
        self._computers: dict[str, set[str]] = {}
        self._closed: dict[str, frozenset[str]] = {}
        """Per namespace the nodes that do not admit it; forgotten at every change."""

    def __repr__(self) -> str:
        return f"Tenants({len(self._allowed)} nodes restrict their tenants)"

    def apply(self, node: str, labels: Mapping[str, str], annotations: Mapping[str, str]) -> bool:
        """Take in a node as it is now. True when some node may admit other namespaces than before."""
        robot, allowed = labels.get(Label.ROBOT, ""), admitted(annotations.get(Annotation.ALLOWED_NAMESPACES))
        if (robot, allowed) == (self._robot_of.get(node, ""), self._allowed.get(node)):
            return False
        restricted = bool(self._allowed)
        self._forget(node)
        if robot:
            self._robot_of[node] = robot
            self._computers.setdefault(robot, set()).add(node)
        if allowed is not None:
            self._allowed[node] = allowed
        self._closed.clear()
        return restricted or allowed is not None

    def remove(self, node: str) -> bool:
        """The node is gone, and its annotation with it. True when another node may admit other namespaces than before."""
        restricted = node in self._allowed
        self._forget(node)
        self._closed.clear()
        return restricted

    def closed_to(self, namespace: str) -> frozenset[str]:
        """Names of the nodes that pods of this namespace may not use."""
        if not self._allowed:
            return frozenset()
        found = self._closed.get(namespace)
        if found is None:
            refusing = (node for node, allowed in self._allowed.items() if namespace not in allowed)
            found = self._closed[namespace] = frozenset(self._with_siblings(refusing))
        return found

    def _with_siblings(self, nodes: Iterable[str]) -> Iterable[str]:
        for node in nodes:
            yield node
            yield from self._computers.get(self._robot_of.get(node, ""), ())

    def _forget(self, node: str) -> None:
        self._allowed.pop(node, None)
        robot = self._robot_of.pop(node, "")
        computers = self._computers.get(robot, set())
        computers.discard(node)
        if not computers:
            self._computers.pop(robot, None)
