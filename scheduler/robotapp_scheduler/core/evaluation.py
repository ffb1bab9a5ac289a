"""All filters and scores of a profile for one pod class: first reason per row, weighted total per row."""

from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.changes import NODE
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.explain import Refusal
from robotapp_scheduler.core.filter_column import HOLE, Codes, FilterColumn, Reasons
from robotapp_scheduler.core.framework import PluginError
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.repair import MOST_REPAIRED
from robotapp_scheduler.core.score_column import ScoreColumn
from robotapp_scheduler.core.view import Nodes

INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""


class Tally:
    """How often an evaluation was used with the same outcome per plugin: counted here, added up when somebody asks."""

    __slots__ = ("count", "keys", "revision")

    def __init__(self) -> None:
        self.revision = -1
        self.count = 0
        self.keys: tuple[tuple[str, str, str], ...] = ()


class Evaluation:
    """The combined columns of one pod class over all rows, or of one pod over a few."""

    def __init__(self, filters: list[FilterColumn], scores: list[ScoreColumn], reasons: Reasons) -> None:
        self.filters = filters
        self.scores = scores
        self.reasons = reasons
        self.reason: Codes = np.zeros(0, dtype=np.int32)
        """First failing reason per row; 0 = feasible, HOLE = no node."""
        self.total: IntArray = np.zeros(0, dtype=np.int64)
        """Weighted total per row, INFEASIBLE where `reason` is not 0. Only valid after `refresh_scores`."""
        self.shares: dict[str, IntArray] = {}
        """Normalised scores per row of plugins whose normalising looks at the whole feasible set."""
        self.tally = Tally()
        self.feasible = 0
        self.revision = 0
        """Grows whenever `reason` changes, so that what is derived from it can be kept."""
        self.refusals: tuple[int, tuple[Refusal, ...]] | None = None
        """Explain's view of the refusals and the revision it was made of."""
        self.rows: npt.NDArray[np.intp] | None = None
        """The table rows in view, None = all."""
        self._live_filters = filters
        self._live_scores = scores
        self._position = -1
        self._epochs = -1
        self._scored_position = -1
        self._scored_epochs = -1
        self._scored_revision = -1
        self._combines = 0
        self._scored_combines = -1
        self._counted: tuple[int, dict[int, int]] = (-1, {})
        self._interest = int(NODE)
        self._score_interest = 0
        for column in filters:
            self._interest |= column.plugin.interest
        for score in scores:
            self._score_interest |= score.plugin.interest

    def __repr__(self) -> str:
        return f"Evaluation({self.feasible} of {len(self.reason)} rows feasible)"

    # --- Filters -------------------------------------------------------------------------------------------------

    def refresh_filters(self, pod: PodInfo, cluster: Cluster, full: Nodes) -> None:
        """Bring `reason` up to date."""
        position = cluster.log.position
        if position == self._position and len(self.reason) == full.n:
            return
        epochs = 0
        for column in self._live_filters:
            column.refresh(pod, cluster, full)
            epochs += column.epoch
        if self._position < 0:
            # A plugin has no opinion because of the pod alone, so it need not be asked again for this class.
            self._live_filters = [column for column in self.filters if not column.skipped]
            epochs = sum(column.epoch for column in self._live_filters)
        rows = None
        if epochs == self._epochs and len(self.reason) == full.n:
            rows = cluster.log.since(self._position, self._interest, most=MOST_REPAIRED)
        if rows is None:
            self._combine_all(full)
        elif rows:
            self._combine_rows(rows, cluster)
        self._position, self._epochs = position, epochs

    def compute_filters(self, pod: PodInfo, nodes: Nodes) -> None:
        """Fill `reason` for exactly these rows, nothing kept."""
        for column in self.filters:
            column.compute(pod, nodes)
        self._combine_all(nodes)

    def _combine_all(self, nodes: Nodes) -> None:
        self.rows = None if isinstance(nodes.rows, slice) else nodes.rows
        reason = np.where(nodes.valid, np.int32(0), np.int32(HOLE))
        for column in self.filters:
            if not column.clean:
                np.copyto(reason, column.codes, where=reason == 0)
        self.reason = reason
        self.feasible = int(np.count_nonzero(reason == 0))
        self.revision += 1
        self._combines += 1

    def _combine_rows(self, rows: list[int], cluster: Cluster) -> None:
        valid = cluster.nodes.valid
        for row in rows:
            code = 0 if valid[row] else HOLE
            if code == 0:
                for column in self._live_filters:
                    if not column.clean and (code := int(column.codes[row])):
                        break
            before = int(self.reason[row])
            if before != code:
                self.reason[row] = code
                self.feasible += (code == 0) - (before == 0)
                self.revision += 1

    # --- Scores --------------------------------------------------------------------------------------------------

    def refresh_scores(self, pod: PodInfo, cluster: Cluster, full: Nodes) -> None:
        """Bring `total` up to date. Raises PluginError when a plugin's score cannot be used."""
        position = cluster.log.position
        epochs = 0
        local = True
        for column in self._live_scores:
            column.refresh(pod, cluster, full)
            epochs += column.epoch
            local = local and (column.skipped or column.local)
        if self._scored_position < 0:
            self._live_scores = [column for column in self.scores if not column.skipped]
            epochs = sum(column.epoch for column in self._live_scores)
        same_shape = (
            epochs == self._scored_epochs and self._combines == self._scored_combines and len(self.total) == full.n
        )
        if same_shape and position == self._scored_position and self.revision == self._scored_revision:
            return
        rows = None
        if local and same_shape:
            interest = self._interest | self._score_interest
            rows = cluster.log.since(self._scored_position, interest, most=MOST_REPAIRED)
        if rows is None:
            self._add_up_all()
        elif rows:
            self._add_up_rows(rows)
        self._scored_position, self._scored_epochs, self._scored_revision = position, epochs, self.revision
        self._scored_combines = self._combines

    def compute_scores(self, pod: PodInfo, nodes: Nodes) -> None:
        """Fill `total` for exactly these rows."""
        for column in self.scores:
            column.compute(pod, nodes)
        self._add_up_all()

    def _add_up_all(self) -> None:
        feasible = np.flatnonzero(self.reason == 0)
        self.total = np.full(len(self.reason), INFEASIBLE, dtype=np.int64)
        if len(feasible) == 0:
            return
        total: IntArray = np.zeros(len(feasible), dtype=np.int64)
        self.shares = {}
        for column in self.scores:
            if column.skipped:
                continue
            try:
                share = column.normalized(feasible)
            except PluginError:
                if not column.plugin.shadow:
                    raise
                column.fail()
                continue
            if not column.local:
                spread = self.shares[column.plugin.name] = np.zeros(len(self.reason), dtype=np.int64)
                spread[feasible] = share
            if not column.plugin.shadow:
                total += column.plugin.weight * share
        self.total[feasible] = total

    def _add_up_rows(self, rows: list[int]) -> None:
        for row in rows:
            if self.reason[row] != 0:
                self.total[row] = INFEASIBLE
                continue
            total = 0
            for column in self._live_scores:
                if column.plugin.shadow:
                    continue
                total += column.plugin.weight * column.at(row)
            self.total[row] = total

    def without(self, rows: list[int]) -> "Evaluation":
        """A copy for one attempt in which these table rows cannot be chosen."""
        copy = Evaluation(self.filters, self.scores, self.reasons)
        copy.reason, copy.rows, copy.feasible = self.reason.copy(), self.rows, self.feasible
        positions = rows if self.rows is None else [i for i, row in enumerate(self.rows) if int(row) in rows]
        for position in positions:
            if copy.reason[position] == 0:
                copy.reason[position] = HOLE
                copy.feasible -= 1
        return copy

    def replaced(self, positions: npt.NDArray[np.intp], reasons: Codes) -> "Evaluation":
        """A copy for one attempt with other reasons at these positions."""
        copy = Evaluation(self.filters, self.scores, self.reasons)
        copy.reason, copy.rows = self.reason.copy(), self.rows
        copy.reason[positions] = reasons
        copy.feasible = int(np.count_nonzero(copy.reason == 0))
        return copy

    def has(self, row: int) -> bool:
        """Is this table row in view?"""
        return self.rows is None or bool((self.rows == row).any())

    def positions(self, rows: npt.NDArray[np.intp] | slice) -> npt.NDArray[np.intp]:
        """Where table rows that are in view are found in `reason`."""
        wanted = np.arange(rows.start, rows.stop) if isinstance(rows, slice) else rows
        if self.rows is None:
            return wanted
        return np.searchsorted(self.rows, wanted)  # rows in view are sorted

    # --- Results -------------------------------------------------------------------------------------------------

    def best(self) -> npt.NDArray[np.intp]:
        """Positions of all feasible rows with the highest total; empty when none is feasible."""
        if self.feasible == 0:
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero(self.total == self.total.max())

    def counts(self) -> dict[int, int]:
        """Rejected rows per reason code."""
        if self._counted[0] != self.revision:
            found = np.bincount(self.reason[self.reason > 0])
            self._counted = (self.revision, {code: int(count) for code, count in enumerate(found) if count})
        return self._counted[1]

    def score_of(self, column: ScoreColumn, positions: npt.NDArray[np.intp]) -> list[int]:
        """Normalised scores of one plugin at feasible positions, after `refresh_scores`."""
        if column.constant is not None:
            return [column.constant] * len(positions)
        source = column.raw if column.local else self.shares[column.plugin.name]
        return [int(score) for score in source[positions].tolist()]

    def texts(self) -> dict[str, int]:
        """Rejected nodes per reason text; a node with several texts counts in each."""
        result: dict[str, int] = {}
        for code, count in self.counts().items():
            for text in self.reasons.values[code].texts:
                result[text] = result.get(text, 0) + count
        return result
