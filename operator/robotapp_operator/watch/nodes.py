"""The cluster's nodes, with version numbers for values computed from all of them."""

import time
from collections.abc import Callable, Iterator, MutableMapping
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from robotapp_api.model.names import Annotation
from robotapp_client.api.times import Now, utc_now
from robotapp_operator.plan.spec.objects import Node


class Lost(NamedTuple):
    """Since when a node is not Ready: `since` by this process' wall clock, to be shown, `since_s` by its monotonic one."""

    since: datetime
    since_s: float


class Nodes(MutableMapping[str, Node]):
    """Nodes by name.

    `identity_version` counts up when a node is added or removed, or when its labels or the namespaces it admits change.
    `readiness_version` counts up when a node becomes ready or unready. Heartbeats change neither.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, now: Now = utc_now) -> None:
        self._clock = clock
        self._now = now
        self._lost: dict[str, Lost] = {}
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
            self._turn(node, seen_ready=before is not None)

    def __delitem__(self, name: str) -> None:
        self._leave(name, self._nodes.pop(name).robot)
        self._lost.pop(name, None)
        self.identity_version += 1
        self.readiness_version += 1

    def __iter__(self) -> Iterator[str]:
        return iter(self._nodes)

    def __len__(self) -> int:
        return len(self._nodes)

    def lost(self, name: str) -> Lost | None:
        """Since when the node is not Ready; None for one that is, or that does not exist."""
        return self._lost.get(name)

    def is_online(self, name: str) -> bool:
        """Returns whether the node is Ready; True for one that does not exist."""
        node = self._nodes.get(name)
        return node is None or node.ready

    def find_address(self, name: str) -> str:
        """Returns where people reach the node; "" for a node without an address, or that does not exist."""
        node = self._nodes.get(name)
        return node.address if node else ""

    @property
    def robots(self) -> set[str]:
        """Robots that have a node."""
        return set(self._of_robot)

    def of_robot(self, robot: str) -> frozenset[str]:
        """Names of the nodes that are computers of `robot`."""
        return frozenset(self._of_robot.get(robot, ()))

    def _turn(self, node: Node, *, seen_ready: bool) -> None:
        """seen_ready: this process saw the node Ready, so that its own clock, not that of a robot, shows since when it is not."""
        name = node.metadata.name
        if node.ready:
            self._lost.pop(name, None)
            return
        now = self._now()
        age = timedelta() if seen_ready else max(timedelta(), now - (_moment(node.readiness_since) or now))
        self._lost[name] = Lost(now - age, self._clock() - age.total_seconds())

    def _leave(self, name: str, robot: str) -> None:
        members = self._of_robot.get(robot, set())
        members.discard(name)
        if not members:
            self._of_robot.pop(robot, None)


def _moment(text: str | None) -> datetime | None:
    try:
        found = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def identity_changed(before: Node, now: Node) -> bool:
    """Did the node's labels change, or the namespaces it admits?"""
    allowed = Annotation.ALLOWED_NAMESPACES
    one, other = before.metadata, now.metadata
    return one.labels != other.labels or one.annotations.get(allowed) != other.annotations.get(allowed)
