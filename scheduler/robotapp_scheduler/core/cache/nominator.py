"""Waiting pods that are nominated to a node: pods of lower or equal importance must leave them their place.

A nomination is made in memory at the decision and stored in status.nominatedNodeName, from where it survives a restart.
"""

from collections.abc import Callable
from typing import NamedTuple

from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo


class Nomination(NamedTuple):
    """What a pod will hold where. `stored` is the node its object names."""

    pod: PodInfo
    record: PlacedPod
    stored: str


class Nominator:
    """By pod, and by node. `record(pod, node)` is what a pod would hold on a node."""

    def __init__(self, record: Callable[[PodInfo, str], PlacedPod]) -> None:
        self._record = record
        self._by_uid: dict[str, Nomination] = {}
        self._by_node: dict[str, dict[str, Nomination]] = {}

    def __repr__(self) -> str:
        return f"Nominator({len(self._by_uid)} pods on {len(self._by_node)} nodes)"

    def __len__(self) -> int:
        return len(self._by_uid)

    def node_of(self, uid: str) -> str:
        """The node this pod waits for, "" without one."""
        found = self._by_uid.get(uid)
        return found.record.node if found is not None else ""

    def see(self, pod: PodInfo) -> bool:
        """A waiting pod as the watch shows it. True when it gave up a node.

        An event without a node, of an object without one, leaves a nomination in memory alone: our own patch is on its way.
        """
        old, stored = self._by_uid.get(pod.uid), pod.pod.status.nominated_node_name
        if old is None and not stored:  # nearly every pod
            return False
        node = old.record.node if old is not None and not (old.stored or stored) else stored
        self._put(pod, node, stored)
        return old is not None and old.record.node != node

    def nominate(self, pod: PodInfo, node: str) -> None:
        """Nominate the pod to a node, or end its nomination (""). The stored node of its object stays as it is."""
        old = self._by_uid.get(pod.uid)
        self._put(pod, node, old.stored if old is not None else pod.pod.status.nominated_node_name)

    def discard(self, uid: str) -> bool:
        """The pod has a node or is gone. True when it was nominated."""
        old = self._by_uid.pop(uid, None)
        if old is None:
            return False
        on_node = self._by_node[old.record.node]
        del on_node[uid]
        if not on_node:
            del self._by_node[old.record.node]
        return True

    def saved(self) -> tuple[Nomination, ...]:
        """All nominations as they are now, for `restore`."""
        return tuple(self._by_uid.values())

    def restore(self, saved: tuple[Nomination, ...]) -> None:
        """Return to the nominations that `saved` gave."""
        self._by_uid.clear()
        self._by_node.clear()
        for found in saved:
            self._by_uid[found.record.uid] = found
            self._by_node.setdefault(found.record.node, {})[found.record.uid] = found

    def at_least(self, priority: int, *, but: str, node: str = "") -> dict[str, list[PlacedPod]]:
        """Node → what pods of this priority or higher will hold there, the pod `but` left out; of one node when given."""
        found: dict[str, list[PlacedPod]] = {}
        for uid, nomination in (self._by_node.get(node, {}) if node else self._by_uid).items():
            if nomination.record.priority >= priority and uid != but:
                found.setdefault(nomination.record.node, []).append(nomination.record)
        return found

    def below(self, priority: int, node: str) -> list[PodInfo]:
        """Pods of lower priority that wait for this node."""
        return [found.pod for found in self._by_node.get(node, {}).values() if found.pod.priority < priority]

    def _put(self, pod: PodInfo, node: str, stored: str) -> None:
        self.discard(pod.uid)
        if node:
            found = self._by_uid[pod.uid] = Nomination(pod, self._record(pod, node), stored)
            self._by_node.setdefault(node, {})[pod.uid] = found
