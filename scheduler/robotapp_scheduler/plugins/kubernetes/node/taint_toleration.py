"""TaintToleration: hard taints exclude nodes, soft ones cost score."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from robotapp_api.values.toleration import HARD_EFFECTS, tolerates
from robotapp_scheduler.core.api.core_v1 import Node, Taint, Toleration
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import FilterResult, ScoreResult
from robotapp_scheduler.core.pods.pod_info import PodInfo

SOFT: Final = "PreferNoSchedule"


class TaintToleration:
    """Distinct taint lists are judged once each and looked up per node."""

    name = "TaintToleration"
    reads = ("tolerations",)
    node_reads = ("taints",)
    row_local = True
    events = Change.NODE_ADDED | Change.TAINTS
    reason = "node(s) had untolerated taint(s)"
    resolvable = False
    normalize = "inverse"

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where every NoSchedule and NoExecute taint is tolerated."""
        codes, sets = nodes.taint_sets
        passes = [untolerated(taints, pod.tolerations, HARD_EFFECTS) == 0 for taints in sets]
        return np.array(passes, dtype=np.bool_)[codes]

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A node that is tolerated now and was not before, or a toleration of the pod itself."""
        if event.resource == "pods":
            return bool(event.old.spec.tolerations != event.new.spec.tolerations)
        before: Node | None = event.old
        return _passes(event.new, pod) and (before is None or not _passes(before, pod))

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """Number of untolerated PreferNoSchedule taints; fewer is better."""
        soft = [t for t in pod.tolerations if t.effect in {"", SOFT}]
        codes, sets = nodes.taint_sets
        counts = [untolerated(taints, soft, frozenset({SOFT})) for taints in sets]
        return np.array(counts, dtype=np.int64)[codes]


def _passes(node: Node | None, pod: PodInfo) -> bool:
    return node is not None and untolerated(node.spec.taints, pod.tolerations, HARD_EFFECTS) == 0


def untolerated(taints: Sequence[Taint], tolerations: Sequence[Toleration], effects: frozenset[str]) -> int:
    """Taints of these effects that no toleration covers."""
    return sum(
        taint.effect in effects and not any(tolerates(toleration, taint) for toleration in tolerations)
        for taint in taints
    )
