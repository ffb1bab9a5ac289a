"""The weighted total of all scores per row, for one pod class.

What a row scores by itself is added up once and mended row by row; scores that are normalised over all feasible rows
("shares") are worked out again when a value or the feasible set changed, and not before.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.best import Best
from robotapp_scheduler.core.changes import NODE
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.filter_column import Codes
from robotapp_scheduler.core.framework import PluginError
from robotapp_scheduler.core.front import Scorers, Sight
from robotapp_scheduler.core.level import Hashes
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.repair import FEW_ROWS, bring_up, view_of
from robotapp_scheduler.core.score_column import Feasible, ScoreColumn
from robotapp_scheduler.core.view import Nodes

EVERY: Final = slice(None)
MOST_SIGHTS: Final = 64
INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""
_NODE: Final = int(NODE)


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


class _Parts(NamedTuple):
    """The columns with an opinion, by how they go into the total. Another epoch of one of them makes this out of date."""

    scorers: Scorers
    flat: int
    """What plugins add that score all rows alike."""
    flats: IntArray
    """The same as an array: to turn a plain number into one takes NumPy longer than to add it to twenty rows."""
    weighted: list[tuple[int, ScoreColumn]]
    """Those that count, and score a row by that row alone, each with its weight."""
    checked: list[ScoreColumn]
    """The same with the shadows."""
    relative: list[ScoreColumn]
    """Those that are normalised over all feasible rows, shadows included."""

    @classmethod
    def of(cls, columns: list[ScoreColumn]) -> "_Parts":
        live = [column for column in columns if not column.skipped]
        counted = [column for column in live if not column.plugin.shadow]
        checked = [column for column in live if column.local and column.constant is None]
        relative = [column for column in live if not column.local]
        flat = sum(column.plugin.weight * column.constant for column in counted if column.constant is not None)
        return cls(
            scorers=Scorers(
                weights={column.plugin.name: column.plugin.weight for column in live},
                shadows=tuple(column.plugin.name for column in live if column.plugin.shadow),
                alike={column.plugin.name: column.constant for column in live if column.constant is not None},
                apart=tuple(column.plugin.name for column in (*checked, *relative)),
            ),
            flat=flat,
            flats=np.array(flat, dtype=np.int64),
            weighted=[(column.plugin.weight, column) for column in checked if not column.plugin.shadow],
            checked=checked,
            relative=relative,
        )


NO_PARTS: Final = _Parts.of([])


class Totals:
    """`total` is true after `refresh` or `compute`. `interest` are the changes after which a verdict may be another."""

    def __init__(self, columns: list[ScoreColumn], interest: int) -> None:
        self.columns = columns
        self.total: IntArray = np.zeros(0, dtype=np.int64)
        """Per row; INFEASIBLE where the row is not feasible."""
        self._live = [column for column in columns if not column.skipped]
        self._parts = NO_PARTS
        self._local: IntArray = np.zeros(0, dtype=np.int64)
        """Sum over the plugins whose score of a row depends on that row alone, feasible or not."""
        self._shares: dict[str, _Share] = {}
        self._open: tuple[int, Feasible] = (-1, EVERY)
        self._position = -1
        self._epochs = -1
        self._revision = -1
        self._combines = -1
        self._best: Best | None = None
        self.sights: dict[int, Sight] = {}
        """Of positions that somebody asked for, until they are added up again."""
        self._interest = interest
        for column in columns:
            self._interest |= column.plugin.interest

    def __repr__(self) -> str:
        return f"Totals({len(self._live)} plugins, {len(self.total)} rows)"

    def refresh(self, pod: PodInfo, full: Nodes, verdicts: Verdicts) -> None:
        """Bring the totals up to date. Raises PluginError when a plugin's score cannot be used."""
        head = full.cluster.log.position
        if head == self._position and verdicts.revision == self._revision:
            return
        epochs, news = bring_up(self._live, pod, full, self._position)
        if self._position < 0:
            # A plugin has no opinion because of the pod alone, so it need not be asked again for this class.
            self._live = [column for column in self.columns if not column.skipped]
            epochs = sum(column.epoch for column in self._live)
        rows: Nodes | None = None
        if epochs == self._epochs and len(self._local) == full.n and news is not None:
            rows = view_of(news, self._interest, full.cluster)
            if news.kinds & _NODE:
                self._best = None  # a row may stand for another node now
                self.sights.clear()
        if rows is None:
            self._parts = _Parts.of(self._live)
            self._add_up_all(full.n)
        if rows is None or rows.n or verdicts.revision != self._revision:
            self._reject_bad(verdicts)
        shared = self._share(pod, full, verdicts)
        same_verdicts = verdicts.combines == self._combines and len(self.total) == full.n
        if rows is None or shared or not same_verdicts or (self._shares and rows.n):
            if rows is not None and rows.n:
                self._add_up_rows(rows)
            self._combine_all(verdicts)
        elif rows.n:
            self._mend_rows(rows, verdicts)
        self._position, self._epochs = head, epochs
        self._revision, self._combines = verdicts.revision, verdicts.combines

    def compute(self, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> None:
        """Make the totals of exactly these rows, nothing kept."""
        for column in self.columns:
            column.compute(pod, nodes)
        self._parts = _Parts.of(self.columns)
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

    @property
    def scorers(self) -> Scorers:
        """The plugins with an opinion."""
        return self._parts.scorers

    def sight(self, position: int, node: str) -> Sight:
        """What there is to say about one feasible position, which stands for this node."""
        found = self.sights.get(position)
        if found is None:
            scores = [column.raw.item(position) for column in self._parts.checked]
            for column in self._parts.relative:
                values = self._shares[column.plugin.name].values
                scores.append(values if isinstance(values, int) else values.item(position))
            if len(self.sights) >= MOST_SIGHTS:
                self.sights.clear()
            found = self.sights[position] = Sight(position, node, self.total.item(position), tuple(scores))
        return found

    def best(self, hashes: Hashes) -> Best:
        """The rows with the highest total, by `hashes` of the node names. One row must be feasible."""
        if self._best is None:
            self._best = Best(self.total, hashes)
        return self._best

    # --- Inside --------------------------------------------------------------------------------------------------

    def _add_up_all(self, rows: int) -> None:
        sums = self._sums(EVERY)
        self._local = np.full(rows, self._parts.flat, dtype=np.int64) if sums is None else sums

    def _add_up_rows(self, stale: Nodes) -> None:
        local = self._local
        if stale.n <= FEW_ROWS:
            for row in stale.row_list:
                local[row] = self._sum_of(row)
            return
        sums = self._sums(stale.rows)
        local[stale.rows] = self._parts.flat if sums is None else sums

    def _sum_of(self, row: int) -> int:
        parts = self._parts
        total = parts.flat
        for weight, column in parts.weighted:
            total += weight * column.raw.item(row)
        return total

    def _sums(self, rows: npt.NDArray[np.intp] | slice) -> IntArray | None:
        """A new array of what these rows score, None when every row scores `flat`."""
        sums: IntArray | None = None
        for weight, column in self._parts.weighted:
            raw = column.raw[rows]
            part = raw if weight == 1 else weight * raw
            sums = part + self._parts.flats if sums is None else sums + part
        return sums

    def _reject_bad(self, verdicts: Verdicts) -> None:
        for column in self._parts.checked:
            if column.bad and not column.skipped:
                try:
                    column.check(verdicts.reason == 0)
                except PluginError:
                    self._forgive(column)

    def _share(self, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> bool:
        """Work out the shares that are not true any more; was there any?"""
        relative = self._parts.relative
        if not relative and not self._shares:
            return False
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
                    self._forgive(column)
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

    def _mend_rows(self, stale: Nodes, verdicts: Verdicts) -> None:
        """Add these rows up again, and nothing is shared: no other row has another total."""
        total, reason, rows = self.total, verdicts.reason, stale.row_list
        if stale.n > FEW_ROWS:
            self._add_up_rows(stale)
            sums = self._local[stale.rows]
            if verdicts.feasible < len(total):
                sums[reason[stale.rows] != 0] = INFEASIBLE
            before, after = total[stale.rows].tolist(), sums.tolist()
            total[stale.rows] = sums
        else:
            before, after = [], []
            for row in rows:
                value = self._local[row] = self._sum_of(row)
                if reason.item(row) != 0:
                    value = INFEASIBLE
                before.append(total.item(row))
                after.append(value)
                total[row] = value
        for row in rows if self.sights else ():
            self.sights.pop(row, None)
        best = self._best
        if best is not None and not best.all_changed(rows, before, after):
            self._best = None

    def _combine_all(self, verdicts: Verdicts) -> None:
        total = self._local
        for column in self._parts.relative:
            if not column.plugin.shadow:
                total = total + column.plugin.weight * self._shares[column.plugin.name].values
        if verdicts.feasible < len(total):
            total = np.where(verdicts.reason == 0, total, np.int64(INFEASIBLE))
        self.total = total.copy() if total is self._local else total
        self._best = None
        self.sights.clear()

    def _forgive(self, column: ScoreColumn) -> None:
        """Called while a PluginError is handled: it is one unless the plugin is a shadow, which says nothing from then on."""
        if not column.plugin.shadow:
            raise  # noqa: PLE0704 - the error that is being handled
        column.fail()
        self._parts = _Parts.of(self._live)
        self.sights.clear()
