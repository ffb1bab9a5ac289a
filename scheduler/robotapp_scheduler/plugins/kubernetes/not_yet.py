"""Features of a pod that this scheduler does not honour yet: refused with a plain reason, never placed wrongly.

Each class has the name of the upstream plugin that will take its place.
"""

from typing import Final

import numpy as np

from robotapp_scheduler.core.changes import NODE, PLACED, Change
from robotapp_scheduler.core.framework import Code, FilterResult, PreFilter, Status
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes

HERE: Final = "is not supported by this scheduler yet; use schedulerName default-scheduler for this pod"


def _refused(what: str) -> PreFilter:
    return PreFilter(status=Status(Code.UNRESOLVABLE, f"{what} {HERE}"))


class PodTopologySpread:
    """Hard spreading; ScheduleAnyway and the system default only score."""

    name = "PodTopologySpread"
    events = Change.NONE

    def pre_filter(self, pod: PodInfo, nodes: Nodes) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Refuses pods with a DoNotSchedule constraint."""
        for constraint in pod.pod.spec.topology_spread_constraints:
            if constraint.when_unsatisfiable == "DoNotSchedule":
                return _refused(f"topologySpreadConstraint on {constraint.topology_key!r} with DoNotSchedule")
        return None


class InterPodAffinity:
    """Own required terms are refused; the required anti-affinity of running pods is honoured."""

    name = "InterPodAffinity"
    reads = ("labels", "namespace")
    node_reads = ("anti_affinity",)
    events = NODE | PLACED | Change.LABELS
    reason = "node(s) didn't satisfy existing pods anti-affinity rules"
    resolvable = True

    def pre_filter(self, pod: PodInfo, nodes: Nodes) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Refuses pods with required affinity or anti-affinity to other pods."""
        affinity = pod.affinity
        if affinity is None:
            return None
        if affinity.pod_affinity is not None and affinity.pod_affinity.required:
            return _refused("required podAffinity")
        if affinity.pod_anti_affinity is not None and affinity.pod_anti_affinity.required:
            return _refused("required podAntiAffinity")
        return None

    def filter(self, pod: PodInfo, nodes: Nodes) -> FilterResult:
        """False in the topology domains that running pods keep free of pods like this one."""
        index = nodes.cluster.anti_affinity
        if not len(index):
            # Not "no opinion": that would be kept until this column is computed anew.
            return np.ones(nodes.n, dtype=np.bool_)
        table = nodes.cluster.nodes
        mask = np.ones(nodes.n, dtype=np.bool_)
        for ward in index.wards(pod):
            row = table.row_of.get(ward.node)
            value = table.labels.of(row).get(ward.topology_key) if row is not None else None
            if value is not None:
                mask &= ~nodes.label(ward.topology_key).equals(value)
        return mask
