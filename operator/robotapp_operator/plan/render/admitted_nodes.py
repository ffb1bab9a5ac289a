"""Keeps pods of other schedulers on nodes that admit their namespace (node annotation robotics.io/allowed-namespaces).

Our scheduler reads the annotation of each node; others do not. So the operator writes into a pod's own node affinity which
nodes it may use, in the write that takes our scheduling gate off the pod. A pod that is gated may be narrowed; its template is
left alone, because every change there would restart what runs.

The nodes that are named are those that admit the namespace. Those that do not are other tenants', and the pod is the tenant's
to read.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.placement.component_nodes import is_in
from robotapp_api.values.selector import NAME_FIELD, matches_term
from robotapp_claims.rules.identity import hash10
from robotapp_operator.plan.spec.objects import Node, Struct

MAX_NAMED: Final = 256
"""Nodes that one pod names at most: 16 KiB of the longest names. Pods of larger clusters each get their own choice of so many."""

EVERY_TERM: Final = "all"
"""Mark of a pod that had no terms before: each of its terms names one node."""
_REQUIRED: Final = "requiredDuringSchedulingIgnoredDuringExecution"


class Requirement(Struct):
    key: str = ""
    operator: str = ""
    values: tuple[str, ...] = ()


class Term(Struct):
    match_expressions: tuple[Requirement, ...] = ()
    match_fields: tuple[Requirement, ...] = ()


class AdmittedNodes(NamedTuple):
    """Whether any node is left for a pod, and the patch of its spec that excludes the others ({}: none has to be).

    mark: for `is_outdated`, the places of the terms whose last expression is the patch's, with an `f` where it is their last field
    that is; EVERY_TERM where all terms are.
    """

    allowed: bool
    patch: Mapping[str, Any] = {}
    mark: str = ""


def admitted_nodes(
    spec: Mapping[str, Any], nodes: Mapping[str, Node], closed: frozenset[str], *, seed: str = ""
) -> AdmittedNodes:
    """The nodes of `spec`, a pod's as plain JSON, without the `closed` ones.

    closed: names of the nodes that do not admit the pod's namespace. While there are any, a pod for which no node is left is
    not let go: one that joins could be closed, too. seed: of the choice among more than MAX_NAMED nodes.
    """
    if not closed:
        return AdmittedNodes(True)
    reach = _reaches(spec, nodes)
    everywhere = frozenset().union(*reach)
    if not everywhere - closed:
        return AdmittedNodes(False)
    if not everywhere & closed:
        return AdmittedNodes(True)
    terms = _terms(spec)
    if not terms:
        names = sorted(_choose(everywhere - closed, seed))
        return AdmittedNodes(True, _patch([{"matchFields": [_named(name)]} for name in names]), EVERY_TERM)
    wide = [found for found in reach if found & closed]
    hosts = _hosts(frozenset().union(*wide) - closed or everywhere - closed, nodes, closed)
    only = is_in(Label.HOSTNAME, *sorted(_choose(hosts, seed)))
    places: list[str] = []
    for place, (term, found) in enumerate(zip(terms, reach, strict=True)):
        if not found & closed:
            continue
        open_nodes = found - closed
        if hosts and not (open_nodes and not _hosts(open_nodes, nodes, closed)):
            terms[place] = {**term, "matchExpressions": [*(term.get("matchExpressions") or ()), only]}
            places.append(str(place))
        else:
            # A field takes one name, and a term may be added to, but not be made two.
            name = _choose(open_nodes or everywhere - closed, seed)[0]
            terms[place] = {**term, "matchFields": [*(term.get("matchFields") or ()), _named(name)]}
            places.append(f"{place}f")
    return AdmittedNodes(True, _patch(terms), ",".join(places))


def _patch(terms: list[dict[str, Any]]) -> dict[str, Any]:
    return {"affinity": {"nodeAffinity": {_REQUIRED: {"nodeSelectorTerms": terms}}}}


def _named(name: str) -> dict[str, Any]:
    """The label kubernetes.io/hostname may differ from a node's name, be missing, or be borne by two."""
    return {"key": NAME_FIELD, "operator": "In", "values": [name]}


def _choose(names: Collection[str], seed: str) -> list[str]:
    """Returns at most MAX_NAMED of them, in an order of the pod's own."""
    return sorted(names, key=lambda name: hash10(f"{seed}/{name}"))[:MAX_NAMED]


def reach_of(spec: Mapping[str, Any], nodes: Mapping[str, Node]) -> frozenset[str]:
    """Names of the nodes that a pod's node selector and required node affinity admit."""
    return frozenset().union(*_reaches(spec, nodes))


def is_outdated(
    spec: Mapping[str, Any],
    mark: str,
    nodes: Mapping[str, Node],
    closed: frozenset[str],
    *,
    reach: Callable[[Mapping[str, Any]], frozenset[str]],
) -> bool:
    """Whether a pod that no scheduler has placed should be replaced: it may use a node that does not admit it (any more), or
    we narrowed it to nodes without one that admits it by now. mark: of our patch, "" for a pod that we did not narrow; what
    else narrows a pod (a RuntimeClass, a queue, a webhook) is not our business. reach: `reach_of` over these nodes.
    """
    now = reach(spec)
    if now & closed:
        return True
    if not mark or len(now) >= MAX_NAMED:
        return False
    missed = reach(_without_our_part(spec, mark)) - closed - now
    return bool(missed if mark == EVERY_TERM else _hosts(missed, nodes, closed))


def wishes_of(spec: Mapping[str, Any]) -> bytes:
    """All of a pod's spec that `reach_of` reads: pods with the same wishes reach the same nodes."""
    return msgspec.json.encode([spec.get("nodeSelector"), _terms(spec)], order="sorted")


def _without_our_part(spec: Mapping[str, Any], mark: str) -> dict[str, Any]:
    """The pod as it was before it was narrowed. A term that was ours alone was there for a pod without any."""
    ours = mark.split(",")
    terms = []
    for place, term in enumerate([] if mark == EVERY_TERM else _terms(spec)):
        for end, key in (("", "matchExpressions"), ("f", "matchFields")):
            term = {**term, key: (term.get(key) or [])[:-1]} if f"{place}{end}" in ours else term  # noqa: PLW2901
        terms.append(term)
    wished = [term for term in terms if term.get("matchExpressions") or term.get("matchFields")]
    required = {_REQUIRED: {"nodeSelectorTerms": wished}}
    return {"nodeSelector": spec.get("nodeSelector"), "affinity": {"nodeAffinity": required if wished else {}}}


def _terms(spec: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The required node selector terms, [] for a pod without any."""
    affinity = (spec.get("affinity") or {}).get("nodeAffinity") or {}
    return list((affinity.get(_REQUIRED) or {}).get("nodeSelectorTerms") or ())


def _reaches(spec: Mapping[str, Any], nodes: Mapping[str, Node]) -> list[frozenset[str]]:
    """Of each required term, or of the node selector alone."""
    return [_reach(spec, term, nodes) for term in _terms(spec)] or [_reach(spec, None, nodes)]


def _reach(spec: Mapping[str, Any], term: Mapping[str, Any] | None, nodes: Mapping[str, Node]) -> frozenset[str]:
    """Of one term; None: of the node selector alone."""
    chosen = (spec.get("nodeSelector") or {}).items()
    parsed = None if term is None else msgspec.convert(term, Term)
    return frozenset(
        name
        for name, node in nodes.items()
        if chosen <= node.metadata.labels.items()
        and (parsed is None or matches_term(parsed, node.metadata.labels, name))
    )


def _hosts(names: frozenset[str], nodes: Mapping[str, Node], closed: frozenset[str]) -> set[str]:
    """Host names of these nodes that no closed node bears as well."""
    taken = {_host(nodes[name]) for name in closed}
    return {_host(nodes[name]) for name in names} - taken - {""}


def _host(node: Node) -> str:
    return node.metadata.labels.get(Label.HOSTNAME, "")
