"""The weighted total of all scores per row, for one pod class: what a row scores by itself, and its shares."""

from typing import Final

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.cluster_event import NODE
from robotapp_scheduler.core.explain.top_nodes import NodePluginScores, Scorers
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import NodeToStatus
from robotapp_scheduler.core.runtime.incremental import FEW_ROWS, view_of
from robotapp_scheduler.core.runtime.normalized_scores import NormalizedScores
from robotapp_scheduler.core.runtime.ranking import INFEASIBLE, Hashes, Ranking
from robotapp_scheduler.core.runtime.row_scores import RowScores
from robotapp_scheduler.core.runtime.score_bounds import ScoreBounds
from robotapp_scheduler.core.runtime.score_results import ScoreColumn

_NODE: Final = int(NODE)


class TotalScores:
    """True after `refresh` or `compute`, but for rows in doubt: whoever asks brings what they are looked at with.

    `interest` are the changes after which a verdict may be another.
    """

    def __init__(self, columns: list[ScoreColumn], interest: int) -> None:
        self._sums = RowScores(columns)
        self._shares = NormalizedScores()
        self._ranking = Ranking()
        self._doubts = ScoreBounds(self._sums, self._ranking)
        self.said = self._ranking.sights
        """What `sight` answered and would answer again."""
        self._position = -1
        self._revision = self._combines = -1
        """Of the verdicts that are in the totals."""
        self._interest = interest
        for column in columns:
            self._interest |= column.plugin.interest

    def __repr__(self) -> str:
        return f"TotalScores({self._sums!r}, {self._doubts!r})"

    # --- Asking --------------------------------------------------------------------------------------------------

    def all(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus) -> IntArray:
        """Per row; INFEASIBLE where the row is not feasible."""
        self._settle(pod, cluster, verdicts)
        return self._ranking.total

    def score_of(
        self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, *, column: ScoreColumn, rows: npt.NDArray[np.intp]
    ) -> list[int]:
        """Normalised scores of one plugin at feasible rows."""
        if column.constant is not None:
            return [column.constant] * len(rows)
        self._settle(pod, cluster, verdicts)
        values = column.raw if column.local else self._shares.of(column)
        if isinstance(values, int):
            return [values] * len(rows)
        scores: list[int] = values[rows].tolist()
        return scores

    @property
    def scorers(self) -> Scorers:
        """The plugins with an opinion."""
        return self._sums.parts.scorers

    def choose(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, *, hashes: Hashes, draw: int) -> int:
        """A row with the highest total, see `TopRows`, by `hashes` of the node names. One row must be feasible."""
        doubtful = self._doubts.rows
        while (found := self._ranking.best(hashes).choose(draw)) in doubtful:
            self._look(pod, cluster, verdicts, [found])
        return found

    def first(
        self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, *, hashes: Hashes, count: int
    ) -> tuple[int, ...]:
        """The best rows, see `TopRows`. So many must be feasible."""
        doubtful = self._doubts.rows
        while not doubtful.isdisjoint(found := self._ranking.best(hashes).first(count)):
            self._look(pod, cluster, verdicts, [row for row in found if row in doubtful])
        return found

    def sight(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, *, row: int, node: str) -> NodePluginScores:
        """What there is to say about one feasible row, which stands for this node."""
        if row in self._doubts.rows:
            self._look(pod, cluster, verdicts, [row])
        found = self.said.get(row)
        if found is None:
            found = NodePluginScores(row, node, self._ranking.total.item(row), self._scores(row))
            self._ranking.say(found)
        return found

    def _scores(self, row: int) -> tuple[int, ...]:
        """Of `Scorers.apart`, in that order."""
        parts = self._sums.parts
        scores = [column.raw.item(row) for column in parts.checked]
        for column in parts.relative:
            values = self._shares.of(column)
            scores.append(values if isinstance(values, int) else values.item(row))
        return tuple(scores)

    def _look(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, rows: list[int]) -> None:
        """Add these rows up, which are in doubt; all of them, when it is quicker."""
        position, self._position = self._position, -1  # should a plugin fail here, everything is added up anew
        done = self._doubts.look(pod, cluster, verdicts, rows)
        self._position = position
        if not done:
            self._settle(pod, cluster, verdicts)

    def _settle(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus) -> None:
        """Add up every row in doubt."""
        if self._doubts.rows:
            position = self._position
            self._add_up(pod, Snapshot(cluster), verdicts)
            self._position = position  # whatever happened since, the filters may not have seen

    # --- Adding up -----------------------------------------------------------------------------------------------

    def refresh(self, pod: PodInfo, full: Snapshot, verdicts: NodeToStatus) -> None:
        """Bring the totals up to date. Raises PluginError when a plugin's score cannot be used."""
        since, head = self._position, full.cluster.log.position
        same = verdicts.revision == self._revision
        if head == since and same:
            return
        if self._doubts.allowed and verdicts.combines == self._combines:
            self._position = -1  # should a plugin fail here, everything is added up anew
            filtered = 0 if same else self._interest
            done = self._doubts.put_off(pod, full, verdicts, since=since, filtered=filtered)
            self._position = since
            if done:
                self._position, self._revision = head, verdicts.revision
                return
        self._add_up(pod, full, verdicts)

    def compute(self, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> None:
        """Make the totals of exactly these rows, nothing kept."""
        for column in self._sums.columns:
            column.compute(pod, nodes)
        self._sums.add_all(nodes.n)
        self._sums.reject_bad(verdicts)
        self._share(pod, nodes, verdicts)
        self._combine_all(verdicts)

    def _add_up(self, pod: PodInfo, full: Snapshot, verdicts: NodeToStatus) -> None:
        """Add up every row that changed or is in doubt."""
        since, self._position = self._position, -1  # should a plugin fail here, everything is added up anew
        same, news = self._sums.bring_up(pod, full, since)
        self._doubts.heard(news)
        rows: Snapshot | None = None
        if same and news is not None:
            rows = view_of(news, self._interest, full.cluster)
            if news.kinds & _NODE:
                self._ranking.renamed()
        if rows is None:
            self._sums.add_all(full.n)
        elif self._doubts.rows:
            rows = Snapshot(full.cluster, [*self._doubts.rows.union(rows.row_list)])
        if (rows is None or rows.n or verdicts.revision != self._revision) and self._sums.reject_bad(verdicts):
            self._ranking.sights.clear()
        shared = self._share(pod, full, verdicts)
        same_verdicts = verdicts.combines == self._combines and len(self._ranking.total) == full.n
        if rows is None or shared or not same_verdicts or (self._shares and rows.n):
            if rows is not None and rows.n:
                self._sums.add_rows(rows)
            self._combine_all(verdicts)
        else:
            if rows.n:
                self._mend_rows(rows, verdicts)
            self._doubts.learn(pod, full)
        self._doubts.settled()
        self._position = full.cluster.log.position
        self._revision, self._combines = verdicts.revision, verdicts.combines

    def _share(self, pod: PodInfo, nodes: Snapshot, verdicts: NodeToStatus) -> bool:
        """Work out the shares that are not true any more; was there any?"""
        relative, shares = self._sums.parts.relative, self._shares
        if not relative and not shares:
            return False
        found = len(relative) != len(shares)
        if found:
            shares.clear()
        for column in relative:
            try:
                found = shares.refresh(column, pod, nodes, verdicts) or found
            except PluginError as error:
                self._sums.forgive(column, error)
                self._ranking.sights.clear()
                found = True
        return found

    def _mend_rows(self, stale: Snapshot, verdicts: NodeToStatus) -> None:
        """Add these rows up again, and nothing is shared: no other row has another total."""
        self._sums.add_rows(stale)
        local, reason = self._sums.local, verdicts.reason
        if stale.n > FEW_ROWS:
            totals = local[stale.rows]
            if verdicts.feasible < len(reason):
                totals[reason[stale.rows] != 0] = INFEASIBLE
            self._ranking.put_many(stale.row_list, stale.rows, totals)
        else:
            rows = stale.row_list
            self._ranking.put(rows, [INFEASIBLE if reason.item(row) else local.item(row) for row in rows])
        self._doubts.learn_rows(stale)

    def _combine_all(self, verdicts: NodeToStatus) -> None:
        total = self._sums.local
        for column in self._sums.parts.relative:
            if not column.plugin.shadow:
                total = total + column.plugin.weight * self._shares.of(column)
        if verdicts.feasible < len(total):
            total = np.where(verdicts.reason == 0, total, np.int64(INFEASIBLE))
        self._ranking.replace(total.copy() if total is self._sums.local else total)
        self._doubts.forget()
