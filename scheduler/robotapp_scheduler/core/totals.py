"""The weighted total of all scores per row, for one pod class.

What a row scores by itself is added up once and mended row by row; scores that are normalised over all feasible rows
("shares") are worked out again when a value or the feasible set changed, and not before.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.best import Best
from robotapp_scheduler.core.changes import NODE
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.doubts import MOST_LOOKS, Doubts, rows_of
from robotapp_scheduler.core.framework import PluginError
from robotapp_scheduler.core.front import Scorers, Sight
from robotapp_scheduler.core.level import Hashes
from robotapp_scheduler.core.parts import NO_PARTS, Parts
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.repair import FEW_ROWS, MOST_REPAIRED, bring_up, view_of
from robotapp_scheduler.core.score_column import Feasible, ScoreColumn
from robotapp_scheduler.core.verdicts import Verdicts
from robotapp_scheduler.core.view import Nodes

EVERY: Final = slice(None)
MOST_SIGHTS: Final = 64
MANY_ROWS: Final = 256
"""From here on the best rows are looked for anew, not moved one by one."""
INFEASIBLE: Final = -1
"""Total of rows that cannot be chosen."""
_NODE: Final = int(NODE)


class _Share(NamedTuple):
    """A normalised score per row (or one number for all), and what it was made of."""

    stamp: tuple[int, int, int]
    values: IntArray | int


class Totals:
    """`total` is true after `refresh` or `compute`. `interest` are the changes after which a verdict may be another."""

    def __init__(self, columns: list[ScoreColumn], interest: int) -> None:
        self.columns = columns
        self._total: IntArray = np.zeros(0, dtype=np.int64)
        self._doubts = Doubts()
        self._doubtful = self._doubts.rows
        """The rows for which `_total` is a bound."""
        self._asked: tuple[PodInfo, Cluster, Verdicts] | None = None
        """What they are looked at with."""
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
        return f"Totals({len(self._live)} plugins, {len(self._total)} rows)"

    @property
    def total(self) -> IntArray:
        """Per row; INFEASIBLE where the row is not feasible."""
        self._settle()
        return self._total

    def refresh(self, pod: PodInfo, full: Nodes, verdicts: Verdicts) -> None:
        """Bring the totals up to date. Raises PluginError when a plugin's score cannot be used."""
        head = full.cluster.log.position
        if head == self._position and verdicts.revision == self._revision:
            return
        if self._doubts.easy is None or not self._put_off(pod, full, verdicts):
            self._bring_up(pod, full, verdicts)

    def _bring_up(self, pod: PodInfo, full: Nodes, verdicts: Verdicts) -> None:
        """Add up every row that changed or is in doubt."""
        head = full.cluster.log.position
        epochs, news = bring_up(self._live, pod, full, self._position)
        if self._position < 0:
            # A plugin has no opinion because of the pod alone, so it need not be asked again for this class.
            self._live = [column for column in self.columns if not column.skipped]
            epochs = sum(column.epoch for column in self._live)
        if self._doubts.ceilings:
            self._doubts.heard(news)
        rows: Nodes | None = None
        if epochs == self._epochs and len(self._local) == full.n and news is not None:
            rows = view_of(news, self._interest, full.cluster)
            if news.kinds & _NODE:
                self._best = None  # a row may stand for another node now
                self.sights.clear()
        if rows is None:
            self._parts = Parts.of(self._live)
            self._add_up_all(full.n)
        elif self._doubtful:
            rows = Nodes(full.cluster, [*self._doubtful.union(rows.row_list)])
        if rows is None or rows.n or verdicts.revision != self._revision:
            self._reject_bad(verdicts)
        shared = self._share(pod, full, verdicts)
        same_verdicts = verdicts.combines == self._combines and len(self._total) == full.n
        if rows is None or shared or not same_verdicts or (self._shares and rows.n):
            if rows is not None and rows.n:
                self._add_up_rows(rows)
            self._combine_all(verdicts)
        else:
            if rows.n:
                self._mend_rows(rows, verdicts)
            if not self._doubts.judged:
                self._doubts.learn(self._live, pod, full, self._total)
        if self._doubts.easy is not None:
            self._doubts.settled()
        self._doubtful.clear()
        self._position, self._epochs = head, epochs
        self._revision, self._combines = verdicts.revision, verdicts.combines

    def compute(self, pod: PodInfo, nodes: Nodes, verdicts: Verdicts) -> None:
        """Make the totals of exactly these rows, nothing kept."""
        for column in self.columns:
            column.compute(pod, nodes)
        self._parts = Parts.of(self.columns)
        self._add_up_all(nodes.n)
        self._reject_bad(verdicts)
        self._share(pod, nodes, verdicts)
        self._combine_all(verdicts)

    def score_of(self, column: ScoreColumn, positions: npt.NDArray[np.intp]) -> list[int]:
        """Normalised scores of one plugin at feasible positions."""
        if column.constant is not None:
            return [column.constant] * len(positions)
        self._settle()
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
        if position in self._doubtful:
            self._look([position])
        found = self.sights.get(position)
        if found is None:
            scores = [column.raw.item(position) for column in self._parts.checked]
            for column in self._parts.relative:
                values = self._shares[column.plugin.name].values
                scores.append(values if isinstance(values, int) else values.item(position))
            if len(self.sights) >= MOST_SIGHTS:
                self.sights.clear()
            found = self.sights[position] = Sight(position, node, self._total.item(position), tuple(scores))
        return found

    def choose(self, hashes: Hashes, pod: int) -> int:
        """A position with the highest total, see `Best`, by `hashes` of the node names. One row must be feasible."""
        while (found := self._ranked(hashes).choose(pod)) in self._doubtful:
            self._look([found])
        return found

    def first(self, hashes: Hashes, count: int) -> tuple[int, ...]:
        """The positions of the best rows, see `Best`. So many must be feasible."""
        doubtful = self._doubtful
        while not doubtful.isdisjoint(found := self._ranked(hashes).first(count)):
            self._look([position for position in found if position in doubtful])
        return found

    def _ranked(self, hashes: Hashes) -> Best:
        if self._best is None:
            self._best = Best(self._total, hashes)
        return self._best

    # --- Rows in doubt -------------------------------------------------------------------------------------------

    def _put_off(self, pod: PodInfo, full: Nodes, verdicts: Verdicts) -> bool:
        """Bring the totals up to date, but for rows that only took pods: these are in doubt. False: they all must be made."""
        log, doubts, same = full.cluster.log, self._doubts, verdicts.revision == self._revision
        if verdicts.combines != self._combines:
            return False
        news = log.news(self._position, most=MOST_REPAIRED)
        easy = doubts.allowed(news, verdicts=0 if same else self._interest) if news is not None else None
        if news is None or easy is None:
            return False
        epochs = bring_up(easy.others, pod, full, self._position)[0] + sum([each.epoch for each in easy.falling])
        rows = rows_of(news)
        if epochs != self._epochs or rows is None:
            return False
        came, others = rows
        self._asked = (pod, full.cluster, verdicts)
        self._doubt(came)
        if not same:
            total, reason = self._total, verdicts.reason
            changed = [row for row in came if (reason.item(row) == 0) != (total.item(row) >= 0)]
            others = [*others, *[row for row in changed if reason.item(row) == 0]]
            self._close([row for row in changed if reason.item(row) != 0])
        if others:
            self._doubtful.update(others)
            self._look([*dict.fromkeys(others)])
        self._position, self._revision = log.position, verdicts.revision
        return True

    def _doubt(self, rows: list[int]) -> None:
        """Pods came to these rows, and nothing else happened there."""
        self._doubtful.update(rows)
        if not self.sights.keys().isdisjoint(rows):
            for row in rows:
                self.sights.pop(row, None)
        total, limit = self._total, self._doubts.limit
        raised = [row for row in rows if limit.item(row) > total.item(row)]
        if raised:
            before, after = [*map(total.item, raised)], [*map(limit.item, raised)]
            total[raised] = after
            self._moved(raised, before, after)

    def _close(self, rows: list[int]) -> None:
        """These rows are not feasible any more; what they score is not added up."""
        total = self._total
        before = [*map(total.item, rows)]
        for row in rows:
            total[row] = self._doubts.limit[row] = INFEASIBLE
        self._moved(rows, before, [INFEASIBLE] * len(rows))

    def _look(self, positions: list[int]) -> None:
        """Add these rows up, which are in doubt; all of them, when it is quicker. One that is not feasible stays in doubt."""
        doubts = self._doubts
        doubts.looks += len(positions)
        easy, asked = doubts.easy, self._asked
        if doubts.looks > MOST_LOOKS or easy is None or asked is None:
            self._settle()
            return
        pod, cluster, verdicts = asked
        known, self._position = self._position, -1  # should a plugin fail here, everything is added up anew
        before, after = [*map(self._total.item, positions)], []
        for position in positions:
            self.sights.pop(position, None)
            value = INFEASIBLE
            if verdicts.reason.item(position) == 0:
                row = cluster.nodes.rows.get(position)
                epochs = sum([column.look(pod, position, row) for column in easy.falling])
                if epochs:  # what was the same for all rows is not any more
                    self._epochs += epochs
                    self._parts = Parts.of(self._live)
                    self.sights.clear()
                value = self._local[position] = self._sum_of(position)
                self._doubtful.discard(position)
            self._total[position] = value
            doubts.limit[position] = easy.limit(value, position)
            after.append(value)
        self._moved(positions, before, after)
        self._position = known

    def _settle(self) -> None:
        """Add up every row in doubt."""
        if self._doubtful and self._asked is not None:
            pod, cluster, verdicts = self._asked
            position = self._position
            self._bring_up(pod, Nodes(cluster), verdicts)
            self._position = position  # whatever happened since, the filters may not have seen

    def _moved(self, rows: Sequence[int], before: list[int], after: list[int]) -> None:
        best = self._best
        if best is not None and not best.all_changed(rows, before, after):
            self._best = None

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
        total, reason, rows = self._total, verdicts.reason, stale.row_list
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
        if self._doubts.easy is not None:
            self._doubts.learn_rows(self._doubts.easy, total, stale)
        if len(rows) > MANY_ROWS:
            self._best = None
        else:
            self._moved(rows, before, after)

    def _combine_all(self, verdicts: Verdicts) -> None:
        total = self._local
        for column in self._parts.relative:
            if not column.plugin.shadow:
                total = total + column.plugin.weight * self._shares[column.plugin.name].values
        if verdicts.feasible < len(total):
            total = np.where(verdicts.reason == 0, total, np.int64(INFEASIBLE))
        self._total = total.copy() if total is self._local else total
        self._best = None
        self._doubts.forget()
        self.sights.clear()

    def _forgive(self, column: ScoreColumn) -> None:
        """Called while a PluginError is handled: it is one unless the plugin is a shadow, which says nothing from then on."""
        if not column.plugin.shadow:
            raise  # noqa: PLE0704 - the error that is being handled
        column.fail()
        self._parts = Parts.of(self._live)
        self.sights.clear()
