"""InterPodAffinity: near the pods a pod wants, away from those it does not want or that do not want it."""

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
import numpy.typing as npt

from robotapp_api.values.selector import matches_requirements
from robotapp_scheduler.core.api.core_v1 import Affinity, Namespace, Node, PodAffinityTerm
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import PLACED, Change, Event
from robotapp_scheduler.core.framework.incremental import Beside
from robotapp_scheduler.core.framework.interface import FilterResult, PerDomain, PluginError, ScoreResult, Verdict
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.selectors.affinity_index import Pull
from robotapp_scheduler.core.selectors.affinity_terms import NO_TERMS, Kind, Term, Terms, compiled
from robotapp_scheduler.core.selectors.pod_counts import Census, Wanted
from robotapp_scheduler.core.selectors.pod_matcher import Requirements

AFFINITY: Final = "node(s) didn't match pod affinity rules"
ANTI_AFFINITY: Final = "node(s) didn't match pod anti-affinity rules"
EXISTING: Final = "node(s) didn't satisfy existing pods anti-affinity rules"
REASONS: Final = ((EXISTING,), (AFFINITY,), (ANTI_AFFINITY,), (EXISTING,))
RESOLVABLE: Final = (True, False, True, True)
_AFFINITY: Final = 1
_ANTI_AFFINITY: Final = 2
_EXISTING: Final = 3
_SELF_AFFINITY: Final = ("self_affinity",)


class AffinityArgs(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """hardPodAffinityWeight (0 to 100): score of a node for each running pod whose required affinity asks for this one.

    ignorePreferredTermsOfExistingPods: preferred terms of running pods count only for pods that have affinity themselves.
    """

    hard_pod_affinity_weight: int = 1
    ignore_preferred_terms_of_existing_pods: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.hard_pod_affinity_weight <= 100:
            value = self.hard_pod_affinity_weight
            raise ValueError(f"hardPodAffinityWeight: Invalid value: {value}: not in valid range [0, 100]")


class InterPodAffinity:
    """Counts per term and topology domain are kept by the cluster; a pod costs one look-up per node and term."""

    name = "InterPodAffinity"
    reads = ("labels", "namespace", "pod_affinity")
    node_reads = ("labels", "namespaces", "pods")
    hint_reads = ("namespace", "pod_affinity", "self_affinity")
    events = PLACED | Change.NODE_ADDED | Change.LABELS | Change.NOMINATED | Change.NAMESPACES
    normalize = "minmax"
    Args = AffinityArgs

    def __init__(self, args: AffinityArgs | None = None) -> None:
        args = args or AffinityArgs()
        self._hard_weight = args.hard_pod_affinity_weight
        self._ignore = args.ignore_preferred_terms_of_existing_pods
        self._latest: tuple[Event, PodInfo | None, PodInfo | None] | None = None
        """The event of the latest hint, and its pods."""

    def filter(self, pod: PodInfo, nodes: Snapshot) -> FilterResult:
        """The pod's own affinity, its own anti-affinity, then the anti-affinity of placed pods."""
        terms, pull = self._terms(pod, nodes)
        away = pull[Kind.KEEPS_AWAY]
        if not (terms.affinity or terms.anti_affinity or away):
            return True
        disturbed = [
            *[(totals.key, totals.values, _EXISTING) for totals in away],
            *[
                (each.topology_key, _values(nodes, each.topology_key, each), _ANTI_AFFINITY)
                for each in terms.anti_affinity
            ],
        ]
        codes = np.zeros(nodes.n, dtype=np.int8)
        for key, values, verdict in disturbed:
            if nodes.full:
                codes[(values > 0)[nodes.label(key).codes]] = verdict
                continue
            where = nodes.cluster.nodes.labels.column(key)[0]
            for i, row in enumerate(nodes.row_list):
                if values.item(where.item(row)) > 0:
                    codes[i] = verdict
        if terms.affinity:
            codes[~_accompanied(pod, nodes, terms)] = _AFFINITY
        return Verdict(codes == 0, codes=codes, reasons=REASONS, resolvable=RESOLVABLE)

    def score(self, pod: PodInfo, nodes: Snapshot) -> ScoreResult:
        """Σ weight over the preferred terms of the pod and of the pods in a node's domains, required ones included."""
        terms, pull = self._terms(pod, nodes)
        if self._ignore and not terms.preferred:
            return None
        sums: dict[str, IntArray] = {}
        for term in terms.preferred:
            _add(sums, term.topology_key, term.weight * _values(nodes, term.topology_key, term))
        for totals in pull[Kind.WEIGHS]:
            _add(sums, totals.key, totals.values)
        if self._hard_weight:
            for totals in pull[Kind.ATTRACTS]:
                _add(sums, totals.key, self._hard_weight * totals.values)
        there = [(values, nodes.label(key)) for key, values in sums.items() if values[1:].any()]
        for values, _ in there:
            values[0] = 0
        if len(there) < 2:
            return PerDomain(*there[0]) if there else 0
        raw: IntArray = np.zeros(nodes.n, dtype=np.int64)
        for values, label in there:
            raw += values[label.codes]
        return raw

    def minds(self, pod: PodInfo) -> tuple[str, ...]:
        """A pod without terms only minds the terms of others."""
        return self.node_reads if pod.affinity_key else ("labels", "namespaces", "terms")

    def confined(self, pod: PodInfo, nodes: Snapshot, position: int) -> bool:
        """With terms on the hostname only, a pod that comes or goes changes nothing but its own node."""
        topology = nodes.cluster.topology
        terms = topology.terms_of(pod)
        if terms.affinity or not topology.no_wide_terms_since(position):
            return False
        return all(map(topology.single, [term.topology_key for term in (*terms.anti_affinity, *terms.preferred)]))

    def touched_by(self, pod: PodInfo, other: PlacedPod) -> bool:
        """Does a required term of the pod mean the other one, or a required anti-affinity term of the other this pod?"""
        terms = _readable(pod)
        if any(_may_mean(term, other) for term in (*terms.affinity, *terms.anti_affinity)):
            return True
        return any(placed.term.kind is Kind.KEEPS_AWAY and _may_mean(placed.term, pod) for placed in other.terms)

    def beside(self, pod: PodInfo, nodes: Snapshot) -> Beside | None:
        """With anti-affinity on the hostname only, of both sides, no other node matters."""
        terms, pull = self._terms(pod, nodes)
        topology = nodes.cluster.topology
        keys = {*(term.topology_key for term in terms.anti_affinity), *(each.key for each in pull[Kind.KEEPS_AWAY])}
        if terms.affinity or not all(topology.single(key) for key in keys):
            return None
        own = [(term.topology_key, term.matcher(topology.namespaces)) for term in terms.anti_affinity]
        of_namespace = topology.namespaces.labels_of(pod.namespace)

        def takes(row: int, others: Sequence[PlacedPod]) -> bool:
            labels = nodes.labels_of(row)
            for other in others:
                if any(key in labels and meant.matches(other.namespace, other.labels) for key, meant in own):
                    return False
                for term in (placed.term for placed in other.terms):
                    concerned = term.kind is Kind.KEEPS_AWAY and term.topology_key in labels
                    if concerned and term.concerns(pod.namespace, pod.labels, of_namespace):
                        return False
            return True

        return Beside(takes)

    def hint(self, pod: PodInfo, event: Event) -> bool:
        """A pod came that is wanted, one went that is in the way, nodes changed a topology key, or namespaces their labels.

        And a pod went that is wanted, if this one is of its kind: it may have been the last, and the first of a kind may
        go anywhere. kube-scheduler 1.37.1 lets such a pod wait five minutes (kubernetes/kubernetes#141354).
        """
        if event.change & Change.SELF:
            return bool((event.old.metadata.labels or {}) != (event.new.metadata.labels or {}))
        terms = _readable(pod)
        if event.resource == "nodes":
            return _node_matters(event.old, event.new, pod, terms)
        if event.resource == "namespaces":
            return _namespace_matters(event.old, event.new, pod, terms)
        return _company_matters(event, *self._pods_of(event), pod, terms)

    def _pods_of(self, event: Event) -> tuple[PodInfo | None, PodInfo | None]:
        """The pod before and after the event, prepared once for all pods that wait."""
        if self._latest is None or self._latest[0] is not event:
            old, new = (PodInfo(pod) if pod is not None else None for pod in (event.old, event.new))
            self._latest = (event, old, new)
        return self._latest[1:]

    def hint_of_each(self, event: Event) -> bool:
        """A pod went that may have kept others away by their labels."""
        return event.resource == "pods" and event.old is not None and bool(_away(event.old.spec.affinity))

    def _terms(self, pod: PodInfo, nodes: Snapshot) -> tuple[Terms, Pull]:
        topology = nodes.cluster.topology
        terms = topology.terms_of(pod)
        if terms.broken:
            raise PluginError(self.name, f"the selector of {terms.broken} cannot be evaluated")
        return terms, topology.affinity.pull(pod.signature.label_key)


def _values(nodes: Snapshot, key: str, *terms: Term) -> IntArray:
    """Placed pods that all these terms mean, per value of a node label; 0 for nodes without it."""
    topology = nodes.cluster.topology
    matchers = tuple([term.matcher(topology.namespaces) for term in terms])
    values = topology.counter(Wanted(matchers, Census.ALL)).domains(key).values
    values[0] = 0
    return values


def _accompanied(pod: PodInfo, nodes: Snapshot, terms: Terms) -> BoolArray:
    """Nodes with a pod, in each domain, that all terms mean; or, without any such pod, where the pod would be the first."""
    keys = tuple(dict.fromkeys(term.topology_key for term in terms.affinity))
    there: list[npt.NDArray[np.bool_]] = [_values(nodes, key, *terms.affinity) > 0 for key in keys]
    if not any(found.any() for found in there):
        namespaces = nodes.cluster.topology.namespaces
        if all(term.matcher(namespaces).matches(pod.namespace, pod.labels) for term in terms.affinity):
            there = [np.arange(len(found)) > 0 for found in there]
    mask = np.ones(nodes.n, dtype=np.bool_)
    for key, found in zip(keys, there, strict=True):
        mask &= found[nodes.label(key).codes]
    return mask


def _add(sums: dict[str, IntArray], key: str, values: IntArray) -> None:
    sums[key] = values + sums[key] if key in sums else values.copy()


def _readable(pod: PodInfo) -> Terms:
    if pod.affinity is None:
        return NO_TERMS
    found: Terms | None = pod.signature.notes.get(_readable)
    if found is None:
        found = pod.signature.notes[_readable] = compiled(pod.namespace, pod.affinity)
    return found


def _away(affinity: Affinity | None) -> tuple[PodAffinityTerm, ...]:
    """The required anti-affinity terms."""
    away = affinity.pod_anti_affinity if affinity is not None else None
    return away.required if away is not None else ()


def _may_mean(term: Term, pod: PodInfo | PlacedPod) -> bool:
    """Whether the term matches the pod, provided that the labels of the pod's namespace match."""
    return term.may_concern(pod.namespace, pod.labels)


def _may_be_first(pod: PodInfo) -> bool:
    return bool(pod.features(_SELF_AFFINITY)[0])


def _wanted(terms: Terms, other: PodInfo) -> bool:
    return terms.want(other.namespace, other.labels)


def _in_the_way(pod: PodInfo, terms: Terms, other: PodInfo) -> bool:
    """Did the other pod keep the pod away, or the pod's own terms it, or was there one of its kind elsewhere?"""
    theirs = _readable(other).anti_affinity
    if any(_may_mean(term, other) for term in terms.anti_affinity) or any(_may_mean(term, pod) for term in theirs):
        return True
    return _may_be_first(pod) and _wanted(terms, other)


def _company_matters(event: Event, old: PodInfo | None, new: PodInfo | None, pod: PodInfo, terms: Terms) -> bool:
    """Did a pod go, come or change its labels so that it is not in the way any more, or wanted now?"""
    if event.change & (Change.POD_REMOVED | Change.NOMINATED) and old is not None and _in_the_way(pod, terms, old):
        return True
    if event.change & Change.POD_ADDED:
        return new is not None and _wanted(terms, new)
    if new is None or old is None or old.labels == new.labels:
        return False
    freed = any(_may_mean(term, old) and not _may_mean(term, new) for term in terms.anti_affinity)
    before, after = _wanted(terms, old), _wanted(terms, new)
    return freed or (before != after and (after or _may_be_first(pod)))


def _namespace_matters(old: Namespace | None, new: Namespace | None, pod: PodInfo, terms: Terms) -> bool:
    """Is it selected now and was not, or the other way round? Terms of others may not mean the pod's own any more."""
    if new is None:
        return False
    if old is not None and new.metadata.name == pod.namespace:
        return True
    wanted = [term.namespace_requirements for term in (*terms.affinity, *terms.anti_affinity)]
    return any(each and (old is not None and _meets(each, old)) != _meets(each, new) for each in wanted)


def _meets(wanted: Requirements, namespace: Namespace) -> bool:
    return matches_requirements(wanted, namespace.metadata.labels or {})


def _node_matters(old: Node | None, new: Node | None, pod: PodInfo, terms: Terms) -> bool:
    if new is None:
        return False
    if old is None and terms.anti_affinity:
        return True
    before = (old.metadata.labels or {}) if old is not None else {}
    after = new.metadata.labels or {}
    joins = any(after.get(t.topology_key) not in {None, before.get(t.topology_key)} for t in terms.affinity)
    left = (*terms.anti_affinity, *(terms.affinity if _may_be_first(pod) else ()))
    leaves = any(before.get(t.topology_key) not in {None, after.get(t.topology_key)} for t in left)
    return joins or leaves
