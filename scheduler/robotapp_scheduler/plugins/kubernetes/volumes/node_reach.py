"""Which nodes a volume, a class or a report of free room can reach: by node labels alone, as upstream does."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from robotapp_api.values.selector import matches_requirement, valid_requirement, valid_term
from robotapp_scheduler.core.api.core_v1 import NodeSelector, NodeSelectorTerm, Requirement
from robotapp_scheduler.core.api.storage_v1 import PersistentVolume, TopologyTerm
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.plugins.kubernetes.common.node_selector import expression_mask, labels_mask, term_mask

Positions = npt.NDArray[np.intp]


class Reach:
    """Positions of the nodes a volume's node affinity matches, kept while no node changes its labels."""

    def __init__(self) -> None:
        self._state: tuple[int, int, int] = (-1, -1, -1)
        self._by_volume: dict[str, tuple[PersistentVolume, Positions]] = {}
        self._by_affinity: dict[NodeSelector, Positions] = {}

    def mask(self, volume: PersistentVolume, nodes: Snapshot) -> BoolArray:
        """Nodes that can reach the volume."""
        if volume.affinity is None:
            return np.ones(nodes.n, dtype=np.bool_)
        if not nodes.full:
            return affinity_mask(nodes, volume.affinity)
        mask = np.zeros(nodes.n, dtype=np.bool_)
        mask[self.positions(volume, nodes)] = True
        return mask

    def positions(self, volume: PersistentVolume, nodes: Snapshot) -> Positions:
        """The same as positions in the view."""
        affinity = volume.affinity
        if affinity is None:
            return np.arange(nodes.n)
        if not nodes.full:
            return np.flatnonzero(affinity_mask(nodes, affinity))
        state = (id(nodes.cluster), nodes.cluster.nodes.generation, nodes.n)
        if state != self._state:
            self._by_volume.clear()
            self._by_affinity.clear()
            self._state = state
        known = self._by_volume.get(volume.metadata.name)
        if known is not None and known[0] is volume:
            return known[1]
        found = self._by_affinity.get(affinity)
        if found is None:
            found = self._by_affinity[affinity] = np.flatnonzero(affinity_mask(nodes, affinity))
        self._by_volume[volume.metadata.name] = (volume, found)
        return found


def affinity_mask(nodes: Snapshot, affinity: NodeSelector) -> BoolArray:
    """Nodes whose labels match one of the terms. Fields are tested as for a node without a name."""
    mask = np.zeros(nodes.n, dtype=np.bool_)
    for term in affinity.node_selector_terms:
        if not term.match_fields:
            mask |= term_mask(nodes, term)
        elif valid_term(term) and all(matches_requirement(field, None) for field in term.match_fields):
            rest = NodeSelectorTerm(match_expressions=term.match_expressions)
            mask |= term_mask(nodes, rest) if rest.match_expressions else True
    return mask


def topology_mask(nodes: Snapshot, terms: Sequence[TopologyTerm]) -> BoolArray:
    """Nodes in one of a class's allowed topologies; no terms allow every node, an empty term allows none."""
    if not terms:
        return np.ones(nodes.n, dtype=np.bool_)
    mask = np.zeros(nodes.n, dtype=np.bool_)
    for term in terms:
        if not term.match_label_expressions:
            continue
        fits = np.ones(nodes.n, dtype=np.bool_)
        for wanted in term.match_label_expressions:
            fits &= expression_mask(
                nodes.label(wanted.key), Requirement(key=wanted.key, operator="In", values=wanted.values)
            )
        mask |= fits
    return mask


def selector_mask(nodes: Snapshot, selector: Mapping[str, Any] | None) -> BoolArray:
    """Nodes whose labels match a label selector (plain JSON); None and an invalid one match none, {} matches all."""
    if selector is None:
        return np.zeros(nodes.n, dtype=np.bool_)
    mask = labels_mask(nodes, (selector.get("matchLabels") or {}).items())
    for raw in selector.get("matchExpressions") or ():
        expression = Requirement(
            key=raw.get("key", ""), operator=raw.get("operator", ""), values=tuple(raw.get("values") or ())
        )
        if expression.operator in {"Gt", "Lt"} or not valid_requirement(expression):
            return np.zeros(nodes.n, dtype=np.bool_)
        mask &= expression_mask(nodes.label(expression.key), expression)
    return mask
