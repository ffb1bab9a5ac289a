"""The weighted total of all scores per row, for one pod class, and the rows that have the highest one."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.events.cluster_event import NODE
from robotapp_scheduler.core.explain.record import Scorers
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import NodeToStatus
from robotapp_scheduler.core.runtime.incremental import FEW_ROWS, bring_up, view_of
from robotapp_scheduler.core.runtime.ranking import INFEASIBLE, Hashes, TopRows
from robotapp_scheduler.core.runtime.score_results import Feasible, ScoreColumn

EVERY: Final = slice(None)
MANY_ROWS: Final = 256
"""With more changed rows than this the best rows are searched anew, not moved one by one."""
_NODE: Final = int(NODE)


class ScoreParts(NamedTuple):
    """The columns that do not skip, by how they enter the total. Out of date when the epoch of one of them changes."""

    scorers: Scorers
    flat: int
    """Sum of the weighted scores that are equal for all rows."""
    flats: IntArray
    """`flat` as an array: NumPy takes longer to convert a plain number than to add it to twenty rows."""
    weighted: list[tuple[int, ScoreColumn]]
    """Columns whose scores depend on the row alone, with their weights; no shadows."""
    checked: list[ScoreColumn]
    """The same columns with the shadows."""
    relative: list[ScoreColumn]
    """Columns that are normalised over all feasible rows, with the shadows."""

    @classmethod
    def of(cls, columns: list[ScoreColumn]) -> "ScoreParts":
        live = [column for column in columns if not column.skipped]
        counted = [column for column in live if not column.plugin.shadow]
        checked = [column for column in live if column.local and column.constant is None]
        relative = [column for column in live if not column.local]
        flat = sum(column.plugin.weight * column.constant for column in counted if column.constant is not None)
        return cls(
            scorers=Scorers(
                weights={column.plugin.name: column.plugin.weight for column in live},
                shadows=tuple(column.plugin.name for column in live if column.plugin.shadow),
                same={column.plugin.name: column.constant for column in live if column.constant is not None},
                differing=tuple(column.plugin.name for column in (*checked, *relative)),
            ),
            flat=flat,
            flats=np.array(flat, dtype=np.int64),
            weighted=[(column.plugin.weight, column) for column in checked if not column.plugin.shadow],
            checked=checked,
            relative=relative,
        )


class NormalizedScore(NamedTuple):
    """A score that was normalised over all feasible rows: per row, or one number for all."""

    stamp: tuple[int, int, int]
    """Changes of the column, revision of the filters' results, and number of rows when it was computed."""
    values: IntArray | int


class TotalScores:
    """The weighted total per row; valid after `refresh` or `compute`.

    `filter_interest` are the kinds of change after which a row may become feasible or infeasible.
    """

    def __init__(self, columns: list[ScoreColumn], filter_interest: int) -> None:
        self.total: IntArray = np.zeros(0, dtype=np.int64)
        """Per row; INFEASIBLE where the row is not feasible."""
        self._columns = columns
        self._live = [column for column in columns if not column.skipped]
        """The columns whose plugins do not skip such pods."""
        self._parts = ScoreParts.of([])
        self._local: IntArray = np.zeros(0, dtype=np.int64)
        """Per row, feasible or not: the sum of the scores that depend on that row alone."""
        self._normalized: dict[str, NormalizedScore] = {}
        """The other scores, by plugin."""
        self._feasible: tuple[int, Feasible] = (-1, EVERY)
        """The feasible rows, behind the revision of the filters' results they follow from."""
        self._top: TopRows | None = None
        self._position = -1
        self._epochs = -1
        """The sum of the columns' epochs when `_parts` was made; when it changes, everything is computed anew."""
        self._revision = self._combines = -1
        """Those of the filters' results that the totals were computed from."""
        self._interest = filter_interest
        for column in columns:
            self._interest |= column.plugin.interest

    def __repr__(self) -> str:
        return f"TotalScores({len(self._live)} plugins, {len(self.total)} rows)"

    # --- Results -------------------------------------------------------------------------------------------------

    def score_of(self, column: ScoreColumn, rows: npt.NDArray[np.intp]) -> list[int]:
        """Normalised scores of one plugin at feasible rows."""
        if column.constant is not None:
            return [column.constant] * len(rows)
        values = column.raw if column.local else self._normalized[column.plugin.name].values
        if isinstance(values, int):
            return [values] * len(rows)
        scores: list[int] = values[rows].tolist()
        return scores

    @property
    def scorers(self) -> Scorers:
        """The plugins that do not skip; the same object while they and the scores that all rows share do not change."""
        return self._parts.scorers

    def top(self, hashes: Hashes) -> TopRows:
        """The best rows, by `hashes` of the node names. At least one row must be feasible."""
        if self._top is None:
            self._top = TopRows(self.total, hashes)
        return self._top

    def scores_at(self, row: int) -> tuple[int, ...]:
        """The normalised scores of `scorers.differing` at a feasible row, in that order."""
        scores = [column.raw.item(row) for column in self._parts.checked]
        for column in self._parts.relative:
            values = self._normalized[column.plugin.name].values
            scores.append(values if isinstance(values, int) else values.item(row))
        return tuple(scores)

    def scores_of(self, rows: Sequence[int]) -> tuple[tuple[int, ...], ...]:
        """`scores_at` of several rows: by plugin, then by row."""
        index = np.array(rows, dtype=np.intp)
        parts = self._parts
        return tuple([tuple(self.score_of(column, index)) for column in (*parts.checked, *parts.relative)])

    # --- Adding up -----------------------------------------------------------------------------------------------

    def refresh(self, pod: PodInfo, full: Snapshot, verdicts: NodeToStatus) -> None:
        """Bring the totals to the head of the change log. Raises PluginError when a plugin's score cannot be used."""
        since, head = self._position, full.cluster.log.position
        if head == since and verdicts.revision == self._revision:
            return
        self._position = -1  # when a plugin raises here, the next call computes everything anew
        rows = self._bring_up(pod, full, since)
        if rows is None:
            self._add_all(full.n)
        if rows is None or rows.n or verdicts.revision != self._revision:
            self._reject_bad(verdicts)
        normalized = self._normalize(pod, full, verdicts)
        same_verdicts = verdicts.combines == self._combines and len(self.total) == full.n
        if rows is None or normalized or not same_verdicts or (self._normalized and rows.n):
            if rows is not None and rows.n:
                self._add_rows(rows)
            self._combine_all(verdicts)
        elif rows.n:
            self._combine_rows(rows, verdicts)
        self._position = head
        self._revision, self._combines = verdicts.revision, verdicts.combines

    def compute(self, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> None:
        """Compute the totals of exactly these rows, nothing kept. Raises PluginError as `refresh`."""
        for column in self._columns:
            column.compute(pod, nodes)
        self._add_all(nodes.n)
        self._reject_bad(verdicts)
        self._normalize(pod, nodes, verdicts)
        self._combine_all(verdicts)

    def _bring_up(self, pod: PodInfo, full: Snapshot, since: int) -> Snapshot | None:
        """Bring the columns to the head of the log. Returns the rows whose totals must be computed again, None = all."""
        epochs, delta = bring_up(self._live, pod, full, since)
        if since < 0:
            # A plugin skips because of the pod alone, so it skips all pods of this class.
            self._live = [column for column in self._columns if not column.skipped]
            epochs = sum(column.epoch for column in self._live)
        same = epochs == self._epochs and len(self._local) == full.n
        self._epochs = epochs
        return self._stale(full, delta) if same and delta is not None else None

    def _stale(self, full: Snapshot, delta: ChangeLogDelta) -> Snapshot | None:
        if delta.kinds & _NODE:
            self._top = None  # rows may stand for other nodes now
        return view_of(delta, self._interest, full.cluster)

    def _add_all(self, rows: int) -> None:
        self._parts = ScoreParts.of(self._live)
        sums = self._sums(EVERY)
        self._local = np.full(rows, self._parts.flat, dtype=np.int64) if sums is None else sums

    def _add_rows(self, stale: Snapshot) -> None:
        if stale.n > FEW_ROWS:
            sums = self._sums(stale.rows)
            self._local[stale.rows] = self._parts.flat if sums is None else sums
            return
        weighted, flat = self._parts.weighted, self._parts.flat
        for row in stale.row_list:
            total = flat
            for weight, column in weighted:
                total += weight * column.raw.item(row)
            self._local[row] = total

    def _sums(self, rows: npt.NDArray[np.intp] | slice) -> IntArray | None:
        """A new array of these rows' weighted scores, None when every row has `flat`."""
        sums: IntArray | None = None
        for weight, column in self._parts.weighted:
            raw = column.raw[rows]
            part = raw if weight == 1 else weight * raw
            sums = part + self._parts.flats if sums is None else sums + part
        return sums

    def _reject_bad(self, verdicts: NodeToStatus) -> None:
        for column in self._parts.checked:
            if column.bad and not column.skipped:
                try:
                    column.check(verdicts.reason == 0)
                except PluginError as error:
                    self._failed(column, error)

    def _failed(self, column: ScoreColumn, error: PluginError) -> None:
        """Raise the error, unless the plugin is a shadow: that one is left out from now on."""
        if not column.plugin.shadow:
            raise error
        column.fail()
        self._parts = ScoreParts.of(self._live)

    # --- Normalising ---------------------------------------------------------------------------------------------

    def _normalize(self, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> bool:
        """Normalise again what is out of date. True when anything was."""
        relative, known = self._parts.relative, self._normalized
        if not relative and not known:
            return False
        found = len(relative) != len(known)
        if found:
            known.clear()
        for column in relative:
            stamp = (column.changes, verdicts.revision, nodes.n)
            before = known.get(column.plugin.name)
            if before is None or before.stamp != stamp:
                found = True
                try:
                    values = self._normalized_of(column, pod, nodes, verdicts)
                    known[column.plugin.name] = NormalizedScore(stamp, values)
                except PluginError as error:
                    self._failed(column, error)
        return found

    def _normalized_of(
        self, column: ScoreColumn, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus
    ) -> IntArray | int:
        feasible = self._feasible_rows(verdicts)
        values = column.normalized(pod, nodes, feasible)
        if isinstance(values, int) or len(values) == nodes.n:
            return values
        spread: IntArray = np.zeros(nodes.n, dtype=np.int64)
        spread[feasible] = values
        return spread

    def _feasible_rows(self, verdicts: NodeToStatus) -> Feasible:
        if verdicts.feasible == len(verdicts.reason):
            return EVERY
        if self._feasible[0] != verdicts.revision:
            self._feasible = (verdicts.revision, np.flatnonzero(verdicts.reason == 0))
        return self._feasible[1]

    # --- Totals --------------------------------------------------------------------------------------------------

    def _combine_all(self, verdicts: NodeToStatus) -> None:
        total = self._local
        for column in self._parts.relative:
            if not column.plugin.shadow:
                total = total + column.plugin.weight * self._normalized[column.plugin.name].values
        if verdicts.feasible < len(total):
            total = np.where(verdicts.reason == 0, total, np.int64(INFEASIBLE))
        self.total = total.copy() if total is self._local else total
        self._top = None

    def _combine_rows(self, stale: Snapshot, verdicts: NodeToStatus) -> None:
        """Compute the totals of these rows again; as nothing is normalised, no other total changes."""
        self._add_rows(stale)
        rows, reason, total = stale.row_list, verdicts.reason, self.total
        if stale.n > FEW_ROWS:
            totals = self._local[stale.rows]
            if verdicts.feasible < len(reason):
                totals[reason[stale.rows] != 0] = INFEASIBLE
            before, after = total[stale.rows].tolist(), totals.tolist()
            total[stale.rows] = totals
        else:
            before = [*map(total.item, rows)]
            after = [INFEASIBLE if reason.item(row) else self._local.item(row) for row in rows]
            for row, value in zip(rows, after, strict=True):
                total[row] = value
        if self._top is not None and (len(rows) > MANY_ROWS or not self._top.all_changed(rows, before, after)):
            self._top = None
