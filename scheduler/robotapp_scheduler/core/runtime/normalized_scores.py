"""Scores that are normalised over all feasible rows: worked out again when a value or the feasible set changed."""

from typing import Final, NamedTuple

import numpy as np

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import NodeToStatus
from robotapp_scheduler.core.runtime.score_results import Feasible, ScoreColumn

EVERY: Final = slice(None)


class _Share(NamedTuple):
    """A normalised score per row (or one number for all), and what it was made of."""

    stamp: tuple[int, int, int]
    values: IntArray | int


class NormalizedScores:
    """What the relative columns of one class say, by plugin."""

    def __init__(self) -> None:
        self._known: dict[str, _Share] = {}
        self._open: tuple[int, Feasible] = (-1, EVERY)
        """The feasible rows, and the revision of the verdicts they follow from."""

    def __repr__(self) -> str:
        return f"NormalizedScores({', '.join(self._known)})"

    def __len__(self) -> int:
        return len(self._known)

    def of(self, column: ScoreColumn) -> IntArray | int:
        """Per row, or for all of them."""
        return self._known[column.plugin.name].values

    def clear(self) -> None:
        """Other columns are relative now."""
        self._known = {}

    def refresh(self, column: ScoreColumn, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> bool:
        """Make what this column says true again; was it not? Raises PluginError when its score cannot be used."""
        stamp = (column.changes, verdicts.revision, nodes.n)
        known = self._known.get(column.plugin.name)
        if known is not None and known.stamp == stamp:
            return False
        self._known[column.plugin.name] = _Share(stamp, self._spread(column, pod, nodes, verdicts))
        return True

    def _spread(self, column: ScoreColumn, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> IntArray | int:
        feasible = self._feasible(verdicts)
        values = column.normalized(pod, nodes, feasible)
        if isinstance(values, int) or len(values) == nodes.n:
            return values
        spread: IntArray = np.zeros(nodes.n, dtype=np.int64)
        spread[feasible] = values
        return spread

    def _feasible(self, verdicts: NodeToStatus) -> Feasible:
        if verdicts.feasible == len(verdicts.reason):
            return EVERY
        if self._open[0] != verdicts.revision:
            self._open = (verdicts.revision, np.flatnonzero(verdicts.reason == 0))
        return self._open[1]
