"""The weighted total of all scores per row, for one pod class.

What a row scores by itself is added up once and mended row by row; scores that are normalised over all feasible rows
("shares") are worked out again when a value or the feasible set changed, and not before.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.changes import News
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.filter_column import Codes
from robotapp_scheduler.core.framework import PluginError
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.repair import FEW_ROWS, MOST_REPAIRED, view_of
from robotapp_scheduler.core.score_column import Feasible, ScoreColumn
from robotapp_scheduler.core.view import Nodes

EVERY: Final = slice(None)
INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""


class Verdicts(NamedTuple):
    """What the filters say: first reason per row (0 = feasible), how many are feasible, and when that changed."""

    reason: Codes
    feasible: int
    revision: int
    """Grows whenever `reason` changes."""
    combines: int
    """Grows when any row may have changed."""


class _Share(NamedTuple):
    """A normalised score per row (or one number for all), and what it was made of."""

    stamp: tuple[int, int, int]
    values: IntArray | int


class Totals:
    """`total` is true after `refresh` or `compute`. `interest` are the changes after which a verdict may be another."""

    def __init__(self, columns: list[ScoreColumn], interest: int) -> None:
        self.columns = columns
        self.total: IntArray = np.zeros(0, dtype=np.int64)
        """Per row; INFEASIBLE where the row is not feasible."""
        self._live = columns
        self._local: IntArray = np.zeros(0, dtype=np.int64)
        """Sum over the plugins whose score of a row depends on that row alone, feasible or not."""
        self._shares: dict[str, _Share] = {}
        self._open: tuple[int, Feasible] = (-1, EVERY)
        self._position = -1
        self._epochs = -1
        self._revision = -1
        self._combines = -1
        self._scored_by: tuple[list[ScoreColumn], dict[str, int], tuple[str, ...]] = ([], {}, ())
        self._interest = interest
        for column in columns:
            self._interest |= column.plugin.interest

    def __repr__(self) -> str:
        return f"Totals({len(self._live)} plugins, {len(self.total)} rows)"

    def refresh(self, pod: PodInfo, full: Nodes, verdicts: Verdicts) -> None:
        """Bring the totals up to date. Raises PluginError when a plugin's score cannot be used."""
        log = full.cluster.log
        head, news = log.position, log.news(self._position, most=MOST_REPAIRED)
        epochs = self._refresh_columns(pod, full, news, head)
        rows: Nodes | None = None
        if epochs == self._epochs and len(self._local) == full.n and news is not None:
            rows = view_of(news, self._interest, full.cluster)
        if rows is None:
            self._add_up_all(full.n)
        elif rows.n:
            self._add_up_rows(rows)
        if rows is None or rows.n or verdicts.revision != self._revision:
            self._reject_bad(verdicts)
        shared = self._share(pod, full, verdicts)
        same_verdicts = verdicts.combines == self._combines and len(self.total) == full.n
        if rows is None or shared or not same_verdicts or (self._shares and rows.n):
            self._combine_all(verdicts)
        elif rows.n:
            self._combine_rows(rows, verdicts.reason)
        self._position, self._epochs = head, epochs
        self._revision, self._combines = verdicts.revision, verdicts.combines

    def compute(self, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> None:
        """Make the totals of exactly these rows, nothing kept."""
        for column in self.columns:
            column.compute(pod, nodes)
        self._add_up_all(nodes.n)
        self._reject_bad(verdicts)
        self._share(pod, nodes, verdicts)
        self._combine_all(verdicts)

    def score_of(self, column: ScoreColumn, positions: npt.NDArray[np.intp]) -> list[int]:
        """Normalised scores of one plugin at feasible positions."""
        if column.constant is not None:
            return [column.constant] * len(positions)
        values = column.raw if column.local else self._shares[column.plugin.name].values
        if isinstance(values, int):
            return [values] * len(positions)
        scores: list[int] = values[positions].tolist()
        return scores

    def scored_by(self) -> tuple[list[ScoreColumn], dict[str, int], tuple[str, ...]]:
        """The plugins with an opinion, their weights, and which of them are shadows."""
        live = [column for column in self._live if not column.skipped]
        if len(live) != len(self._scored_by[0]):
            weights = {column.plugin.name: column.plugin.weight for column in live}
            shadows = tuple(column.plugin.name for column in live if column.plugin.shadow)
            self._scored_by = (live, weights, shadows)
        return self._scored_by

    # --- Inside --------------------------------------------------------------------------------------------------

    def _refresh_columns(self, pod: PodInfo, full: Nodes, news: News | None, head: int) -> int:
        kinds = news.kinds if news is not None else 0
        epochs = 0
        for column in self._live:
            # What did not change since these totals did not change since the column was looked at, either.
            if news is not None and not kinds & column.plugin.watches and self._position <= column.position <= head:
                column.position = head
            else:
                column.refresh(pod, full.cluster, full)
            epochs += column.epoch
        if self._position < 0:
            # A plugin has no opinion because of the pod alone, so it need not be asked again for this class.
            self._live = [column for column in self.columns if not column.skipped]
            epochs = sum(column.epoch for column in self._live)
        return epochs

    def _counted(self, *, local: bool) -> list[ScoreColumn]:
        return [each for each in self._live if not (each.skipped or each.plugin.shadow) and each.local is local]

    def _add_up_all(self, rows: int) -> None:
        columns = self._counted(local=True)
        self._local = np.full(rows, _flat(columns), dtype=np.int64)
        for column in columns:
            if column.constant is None:
                self._local += column.plugin.weight * column.raw

    def _add_up_rows(self, stale: Nodes) -> None:
        columns = self._counted(local=True)
        flat = _flat(columns)
        varying = [(column.plugin.weight, column.raw) for column in columns if column.constant is None]
        if stale.n <= FEW_ROWS:
            for row in stale.row_list:
                self._local[row] = flat + sum(weight * raw.item(row) for weight, raw in varying)
            return
        total: IntArray = np.full(stale.n, flat, dtype=np.int64)
        for weight, raw in varying:
            total += weight * raw[stale.rows]
        self._local[stale.rows] = total

    def _reject_bad(self, verdicts: Verdicts) -> None:
        for column in self._live:
            if column.bad and column.local and not column.skipped:
                try:
                    column.check(verdicts.reason == 0)
                except PluginError:
                    _forgiven(column)

    def _share(self, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> bool:
        """Work out the shares that are not true any more; was there any?"""
        relative = [column for column in self._live if not (column.skipped or column.local)]
        found = len(relative) != len(self._shares)
        if found:
            self._shares = {}
        for column in relative:
            stamp = (column.changes, verdicts.revision, nodes.n)
            known = self._shares.get(column.plugin.name)
            if known is None or known.stamp != stamp:
                found = True
                try:
                    self._shares[column.plugin.name] = _Share(stamp, self._spread(column, pod, nodes, verdicts))
                except PluginError:
                    _forgiven(column)
        return found

    def _spread(self, column: ScoreColumn, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> IntArray | int:
        feasible = self._feasible(verdicts)
        values = column.normalized(pod, nodes, feasible)
        if isinstance(values, int) or len(values) == nodes.n:
            return values
        spread: IntArray = np.zeros(nodes.n, dtype=np.int64)
        spread[feasible] = values
        return spread

    def _feasible(self, verdicts: Verdicts) -> Feasible:
        if verdicts.feasible == len(verdicts.reason):
            return EVERY
        if self._open[0] != verdicts.revision:
            self._open = (verdicts.revision, np.flatnonzero(verdicts.reason == 0))
        return self._open[1]

    def _combine_rows(self, stale: Nodes, reason: Codes) -> None:
        if stale.n > FEW_ROWS:
            rows = stale.rows
            self.total[rows] = np.where(reason[rows] == 0, self._local[rows], INFEASIBLE)
            return
        for row in stale.row_list:
            self.total[row] = self._local[row] if reason[row] == 0 else INFEASIBLE

    def _combine_all(self, verdicts: Verdicts) -> None:
        total = self._local.copy()
        for column in self._counted(local=False):
            total += column.plugin.weight * self._shares[column.plugin.name].values
        if verdicts.feasible < len(total):
            total[verdicts.reason != 0] = INFEASIBLE
        self.total = total


def _forgiven(column: ScoreColumn) -> None:
    """Called while a PluginError is handled: it is one unless the plugin is a shadow, which says nothing from then on."""
    if not column.plugin.shadow:
        raise  # noqa: PLE0704 - the error that is being handled
    column.fail()


def _flat(columns: list[ScoreColumn]) -> int:
    """What plugins add that score all rows alike."""
    return sum(column.plugin.weight * column.constant for column in columns if column.constant is not None)
