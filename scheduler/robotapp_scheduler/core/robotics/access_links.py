"""What nodes' access links carry, what the connections of placed pods take of it, and what a pod or a group would add.

The capacity is the node annotation `robotics.io/link-bandwidth`: no agent can measure it without filling the link. A connection
takes its bandwidth on the links of both its nodes, and nothing where its ends share one. What takes place inside a node,
or at an end that is not placed yet, is not counted.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from robotapp_api.model.names import ROBOT_END, Annotation
from robotapp_api.values.quantities.bandwidth import parse_link_bandwidth
from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.nodes.columns import FloatArray
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.robotics.app_index import App, AppIndex, InstanceKey
from robotapp_scheduler.joint.link_limits import LinkLimits


def _capacity(node: Node) -> float:
    """Infinite where nobody has stated it, or what is stated is no amount (`kubectl robotapp nodes` tells that)."""
    text = (node.metadata.annotations or {}).get(Annotation.LINK_BANDWIDTH)
    try:
        return float("inf") if text is None else float(parse_link_bandwidth(text))
    except ValueError:
        return float("inf")


LINK_BANDWIDTH: Final = NodeFact("link-bandwidth", _capacity, absent=float("inf"))
"""Bit/s that the node's access link carries."""


class AccessLinks:
    """What is left on the nodes' links, kept per instance of an app."""

    def __init__(self, nodes: NodeTable, apps: AppIndex) -> None:
        self._nodes = nodes
        self._apps = apps
        self._generation = -1
        self._loads: dict[InstanceKey, dict[str, int]] = {}
        self._totals: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"AccessLinks({len(self._loads)} instances on {len(self._totals)} nodes)"

    def free(self) -> FloatArray | None:
        """Bit/s left per row, infinite where the link is not known; None when no node's is."""
        nodes = self._nodes
        capacity = nodes.facts.column(LINK_BANDWIDTH, nodes.objects)[: nodes.size]
        if not np.isfinite(capacity).any():
            self._forget()
            return None
        self._update()
        free: FloatArray = capacity.copy()
        for node, bps in self._totals.items():
            row = nodes.row_of.get(node)
            if row is not None:
                free[row] -= bps
        return free

    def flows(self, member: Member, component: str, *, but: str = "") -> Iterator[tuple[str, int]]:
        """Node and bit/s of every placed other end of the component's connections; pods of the uid `but` do not count."""
        app = self._apps.app(member.app_uid)
        for flow in app.flows if app is not None else ():
            for here, peer in ((flow.from_, flow.to), (flow.to, flow.from_)):
                if here == component:
                    for node in self._ends(member, peer, but=but):
                        yield node, flow.bps

    def limits(self, app: App, pods: Sequence[PodInfo]) -> LinkLimits | None:
        """The flows of pods that are planned together; None where nothing limits them."""
        free_bps = self.free() if app.flows else None
        if free_bps is None:
            return None
        of: dict[str, list[int]] = {}
        for i, pod in enumerate(pods):
            if pod.member is not None:
                of.setdefault(pod.member.component, []).append(i)
        pairs = [
            (left, right, flow.bps)
            for flow in app.flows
            for left in of.get(flow.from_, ())
            for right in of.get(flow.to, ())
            if left != right
        ]
        row_of = self._nodes.row_of
        ends = [
            (i, row_of[node], bps)
            for i, pod in enumerate(pods)
            if pod.member is not None
            for node, bps in self.flows(pod.member, pod.member.component, but=pod.uid)
            if node in row_of
        ]
        return LinkLimits(free_bps, tuple(pairs), tuple(ends)) if pairs or ends else None

    # --- Inside ------------------------------------------------------------------------------------------------------

    def _ends(self, member: Member, component: str, *, but: str = "") -> tuple[str, ...]:
        """Nodes of a connection's end. While it is not known which node is `@robot`, it is nowhere."""
        if component == ROBOT_END:
            nodes = self._nodes.robot_end(member.instance)
            return nodes if len(nodes) == 1 else ()
        replicas = self._apps.replicas(member, component)
        return tuple(each.node for each in replicas if each.node and each.pod.metadata.uid != but)

    def _update(self) -> None:
        """Count anew the instances that changed; all of them when nodes did: which one is `@robot` is in their labels."""
        touched = self._apps.take_changed_flows()
        if self._generation != self._nodes.generation:
            self._generation = self._nodes.generation
            touched |= self._loads.keys()
            touched |= set(self._apps.instances())
        for key in touched:
            self._add(self._loads.pop(key, {}), -1)
            load = self._load(*key)
            if load:
                self._loads[key] = load
                self._add(load, +1)

    def _forget(self) -> None:
        """Nothing is limited: without this, the instances that change would be remembered until something is."""
        self._apps.take_changed_flows()
        self._generation = -1
        self._loads.clear()
        self._totals.clear()

    def _add(self, load: dict[str, int], sign: int) -> None:
        for node, bps in load.items():
            total = self._totals.get(node, 0) + sign * bps
            if total:
                self._totals[node] = total
            else:
                self._totals.pop(node, None)

    def _load(self, app_uid: str, instance: str) -> dict[str, int]:
        app = self._apps.app(app_uid)
        member = Member(app_uid, instance, "")
        load: dict[str, int] = {}
        for flow in app.flows if app is not None else ():
            for one in self._ends(member, flow.from_):
                for other in self._ends(member, flow.to):
                    if one != other:
                        load[one] = load.get(one, 0) + flow.bps
                        load[other] = load.get(other, 0) + flow.bps
        return load
