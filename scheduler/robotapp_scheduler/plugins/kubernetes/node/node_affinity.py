"""NodeAffinity: nodeSelector, required and preferred node affinity, and the profile's own addedAffinity."""

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from robotapp_api.values.selector import NAME_FIELD, matches_node_terms, valid_term
from robotapp_scheduler.core.api.core_v1 import Node, NodeSelectorTerm, PreferredTerm
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.interface import (
    Code,
    FilterResult,
    PluginError,
    PreFilter,
    ScoreResult,
    Status,
    Verdict,
)
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.kubernetes.common.arguments import raise_problems
from robotapp_scheduler.plugins.kubernetes.common.node_selector import own_terms_mask, term_mask, terms_mask
from robotapp_scheduler.plugins.kubernetes.node.added_affinity import AddedAffinity, problems

POD_REASON: Final = "node(s) didn't match Pod's node affinity/selector"
ENFORCED_REASON: Final = "node(s) didn't match scheduler-enforced node affinity"
CONFLICT: Final = "pod affinity terms conflict"


class NodeAffinityArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """addedAffinity applies to every pod of the profile, before the pod's own."""

    added_affinity: AddedAffinity | None = None

    def __post_init__(self) -> None:
        raise_problems(problems(self.added_affinity))


class NodeAffinity:
    """Required terms are ORed, expressions inside one are ANDed; preferred terms add their weight."""

    name = "NodeAffinity"
    reads = ("node_affinity", "node_selector")
    node_reads = ("labels", "name")
    row_local = True
    events = Change.NODE_ADDED | Change.LABELS
    resolvable = False
    normalize = "max"
    Args = NodeAffinityArgs

    def __init__(self, args: NodeAffinityArgs | None = None) -> None:
        added = args.added_affinity if args is not None else None
        self._added_required = added.required if added is not None else None
        self._added_preferred = added.preferred if added is not None else ()

    def narrows(self, pod: PodInfo) -> bool:
        """Only pods that require something of the node."""
        return pod.node_affinity is not None and pod.node_affinity.required is not None

    def pre_filter(self, pod: PodInfo, nodes: Snapshot) -> PreFilter | None:  # noqa: ARG002 - the contract's signature
        """Narrow to the nodes that every required term names in metadata.name (how DaemonSet pods come)."""
        affinity = pod.node_affinity
        required = affinity.required if affinity is not None else None
        if required is None or not required.node_selector_terms:
            return None
        names: set[str] = set()
        for term in required.node_selector_terms:
            named = _named(term)
            if named is None:
                return None
            names |= named
        if not names:
            return PreFilter(status=Status(Code.UNRESOLVABLE, CONFLICT))
        return PreFilter(names=frozenset(names))

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """True where labels and name match; Skip when neither the pod nor the configuration requires any."""
        affinity = pod.node_affinity
        required = affinity.required if affinity is not None else None
        if not pod.node_selector and required is None and self._added_required is None:
            return None
        mask = own_terms_mask(pod, nodes)
        if self._added_required is None:
            return Verdict(mask, reasons=((POD_REASON,),))
        enforced = terms_mask(nodes, self._added_required.node_selector_terms)
        codes = np.where(enforced, 0, 1)
        return Verdict(mask & enforced, codes=codes, reasons=((POD_REASON,), (ENFORCED_REASON,)))

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """Sum of the weights of the preferred terms a node matches. Raises PluginError for a term that cannot be read."""
        affinity = pod.node_affinity
        preferred = affinity.preferred if affinity is not None else ()
        if not preferred and not self._added_preferred:
            return None
        return self._weights(preferred, nodes) + self._weights(self._added_preferred, nodes)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """True for a node that matches now and did not before. A pod's own affinity can only change while it is gated."""
        if event.resource != "nodes" or event.new is None:
            return False
        return self._matches(pod, event.new) and (event.old is None or not self._matches(pod, event.old))

    def _matches(self, pod: PodInfo, node: Node) -> bool:
        labels, name = node.metadata.labels or {}, node.metadata.name
        required = (pod.node_affinity.required if pod.node_affinity is not None else None, self._added_required)
        return all(labels.get(key) == value for key, value in pod.node_selector.items()) and all(
            selector is None or matches_node_terms(selector.node_selector_terms, labels, name) for selector in required
        )

    def _weights(self, terms: Sequence[PreferredTerm], nodes: Snapshot) -> IntArray:
        total = np.zeros(nodes.n, dtype=np.int64)
        for i, term in enumerate(terms):
            if term.weight == 0 or not (term.preference.match_expressions or term.preference.match_fields):
                continue
            if not valid_term(term.preference):
                raise PluginError(self.name, f"preferred term {i} has an expression that cannot be evaluated")
            total += term.weight * term_mask(nodes, term.preference)
        return total


def _named(term: NodeSelectorTerm) -> set[str] | None:
    """Names a term allows by metadata.name In; None when it has no such field."""
    found: set[str] | None = None
    for field in term.match_fields:
        if field.key == NAME_FIELD and field.operator == "In":
            found = set(field.values) if found is None else found & set(field.values)
    return found
