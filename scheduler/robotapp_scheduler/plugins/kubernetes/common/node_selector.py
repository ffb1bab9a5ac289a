"""Node selector terms over label columns: the vector twin of `robotapp_api.values.selector`."""

from collections.abc import Iterable

import numpy as np

from robotapp_api.values.selector import integer, valid_term
from robotapp_scheduler.core.api.core_v1 import NodeSelectorTerm, Requirement
from robotapp_scheduler.core.cache.snapshot import LabelColumn, Snapshot
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_info import PodInfo


def own_terms_mask(pod: PodInfo, nodes: Snapshot) -> BoolArray:
    """Nodes that the pod's nodeSelector and required node affinity allow."""
    mask = labels_mask(nodes, pod.node_selector.items())
    required = pod.node_affinity.required if pod.node_affinity is not None else None
    if required is not None:
        mask &= terms_mask(nodes, required.node_selector_terms)
    return mask


def labels_mask(nodes: Snapshot, wanted: Iterable[tuple[str, str]]) -> BoolArray:
    """Nodes that have all these labels."""
    mask = np.ones(nodes.n, dtype=np.bool_)
    for key, value in wanted:
        mask &= nodes.label(key).equals(value)
    return mask


def terms_mask(nodes: Snapshot, terms: Iterable[NodeSelectorTerm]) -> BoolArray:
    """Nodes that match at least one term; invalid and empty terms match none."""
    mask = np.zeros(nodes.n, dtype=np.bool_)
    for term in terms:
        mask |= term_mask(nodes, term)
    return mask


def term_mask(nodes: Snapshot, term: NodeSelectorTerm) -> BoolArray:
    """Nodes that match every expression and field of a term."""
    if not (term.match_expressions or term.match_fields) or not valid_term(term):
        return np.zeros(nodes.n, dtype=np.bool_)
    mask = np.ones(nodes.n, dtype=np.bool_)
    for expression in term.match_expressions:
        mask &= expression_mask(nodes.label(expression.key), expression)
    for field in term.match_fields:
        named = np.zeros(nodes.n, dtype=np.bool_)
        named[nodes.indices(field.values)] = True
        mask &= named if field.operator == "In" else ~named
    return mask


def expression_mask(column: LabelColumn, expression: Requirement) -> BoolArray:
    """Nodes that match one valid expression."""
    match expression.operator:
        case "In":
            return _among(column, expression.values)
        case "NotIn":
            return ~_among(column, expression.values)
        case "Exists":
            return column.exists
        case "DoesNotExist":
            return ~column.exists
    return _compared(column, expression)


def _among(column: LabelColumn, values: Iterable[str]) -> BoolArray:
    known = [code for value in values if (code := column.vocabulary.codes.get(value)) is not None]
    if len(known) == 1:
        return np.equal(column.codes, known[0])
    return np.isin(column.codes, known)


def _compared(column: LabelColumn, expression: Requirement) -> BoolArray:
    """Gt and Lt: every distinct value in view is compared once."""
    limit = integer(expression.values[0])
    codes, where = np.unique(column.codes, return_inverse=True)
    passes = np.zeros(len(codes), dtype=np.bool_)
    for i, code in enumerate(codes):
        actual = integer(column.vocabulary.values[code]) if code else None
        if actual is not None and limit is not None:
            passes[i] = actual > limit if expression.operator == "Gt" else actual < limit
    return passes[where]
