"""Upper bounds on the total score of nodes that only gained pods, so that most need not be rescored.

Where several classes take turns, each finds some twenty rows that the others have used. To add all of them up again costs
as much as the rest of a decision, and most change once more before their total is needed. What such a row scores can
fall, or rise to the ceiling its plugins name: the bound is good enough while it stays below the rows that are chosen.

`BoundsPayoff` measures when bounds pay: not where pods come to the best rows only, or all rows must soon be added up anyway.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.events.cluster_event import OFFERED, PLACED, SAID_OF_PODS, Change
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import NodeToStatus
from robotapp_scheduler.core.runtime.incremental import MOST_REPAIRED, bring_up
from robotapp_scheduler.core.runtime.ranking import INFEASIBLE, Ranking
from robotapp_scheduler.core.runtime.row_scores import RowScores
from robotapp_scheduler.core.runtime.score_results import ScoreColumn, UnderPods

MOST_LOOKS: Final = 8
"""Rows looked at one by one in one decision, before all are added up: in columns they cost a third each."""
SOON: Final = 32
"""When all must be added up after fewer decisions than this, though few rows were in doubt, it does not pay."""
WINDOW: Final = 16
"""Decisions after which is asked whether it pays."""
REST: Final = 16
"""Decisions until it is tried again; twice as many after each time that it did not pay."""
MOST_REST: Final = 4096


class BoundsPayoff:
    """What doubting saved and cost one class of late."""

    __slots__ = ("_came", "_decisions", "_looked", "_looks", "_pause", "_rest")

    def __init__(self) -> None:
        self._pause, self._rest = 0, REST
        self._decisions = 0
        """Since all rows were added up."""
        self._looks = 0
        """Rows looked at one by one in this decision."""
        self._came = self._looked = 0
        """Rows that changed, and rows looked at one by one, in this window."""

    def __repr__(self) -> str:
        return f"BoundsPayoff({self._decisions} decisions, {self._looked} of {self._came} rows looked at, {self._pause} to rest)"

    def rest(self) -> bool:
        """One more decision goes by in which nothing may be doubted. False: it may."""
        resting = self._pause > 0
        self._pause -= resting
        return resting

    def begin(self, came: int) -> None:
        """The next decision, before which so many rows changed."""
        if self._decisions % WINDOW == 0:
            self._came = self._looked = 0
        self._came += came
        self._looked += self._looks
        self._looks = 0
        self._decisions += 1

    @property
    def pays(self) -> bool:
        """At the end of a window: were at most half of the rows that changed looked at one by one?"""
        return self._decisions % WINDOW != 0 or 2 * self._looked <= self._came

    def look(self, rows: int) -> None:
        """So many rows are to be looked at one by one."""
        self._looks += rows

    @property
    def overtaxed(self) -> bool:
        """Is it quicker to add all of them up?"""
        return self._looks > MOST_LOOKS

    def added_up(self) -> None:
        """No row is in doubt any more."""
        self._decisions = 0

    def lose(self) -> bool:
        """It did not pay. True: not for long enough, so nothing is doubted for some time."""
        if self._decisions >= SOON:
            self._rest = REST
            return False
        self._pause = self._rest
        self._rest = min(2 * self._rest, MOST_REST)
        return True


MOST_DOUBTS: Final = 1024
"""Rows; with more than these all are added up."""
MOST_RISING: Final = 1024
"""Rows; of more it costs more to name those whose bound is above their total than to ask each."""
NOTHING: Final = np.array(0, dtype=np.int64)
NO_LIMIT: Final[IntArray] = np.zeros(0, dtype=np.int64)
_ADDED: Final = int(Change.POD_ADDED)
_OTHERWISE: Final = int(PLACED & ~Change.POD_ADDED)


class BoundedColumns(NamedTuple):
    """Columns of one class, none of which must be asked when a pod comes to a row."""

    falling: list[ScoreColumn]
    others: list[ScoreColumn]
    """They say the same as before, or their epoch tells."""
    interest: int
    """Changes after which rows must be looked at though no pod came there."""
    ceilings: list[tuple[int, ScoreColumn, IntArray | int]]
    """With the weight, where the ceiling is above 0."""

    @classmethod
    def of(cls, columns: Sequence[ScoreColumn], pod: PodInfo, full: Snapshot) -> "BoundedColumns | None":
        """None when a row must be added up after each pod, or nothing falls."""
        falling, others, ceilings, interest = [], [], [], 0
        for column in columns:
            taken = column.under_pods(pod, full)
            if taken is UnderPods.ASK:
                return None
            if taken is UnderPods.FALLS:
                falling.append(column)
                ceiling = column.ceiling
                if ceiling is not None and (not isinstance(ceiling, int) or ceiling > 0):
                    ceilings.append((column.plugin.weight, column, ceiling))
            else:
                others.append(column)
            if taken is UnderPods.FALLS or column.constant is None:
                interest |= column.interest  # one of its rows may say something else, and no epoch tells
        return cls(falling, others, interest, ceilings) if falling else None

    def limits(self, total: IntArray, rows: npt.NDArray[np.intp] | slice) -> IntArray:
        """The totals that these rows will not exceed when pods come to them; `total` are those they have now."""
        now = total[rows]
        found = now
        for weight, column, ceiling in self.ceilings:
            most = ceiling if isinstance(ceiling, int) else ceiling[rows]
            rise = np.maximum(most - column.raw[rows], NOTHING)
            found = found + (rise if weight == 1 else weight * rise)
        return np.where(now < NOTHING, now, found)

    def limit(self, total: int, row: int) -> int:
        """The same of one row."""
        for weight, column, ceiling in self.ceilings if total >= 0 else ():
            most = ceiling if isinstance(ceiling, int) else ceiling.item(row)
            total += weight * max(most - column.raw.item(row), 0)
        return total


class ScoreBounds:
    """The rows of one class for which the total in its ranking is a bound, while its columns allow that."""

    def __init__(self, sums: RowScores, ranking: Ranking) -> None:
        self.rows: set[int] = set()
        self._sums, self._ranking = sums, ranking
        self._easy: BoundedColumns | None = None
        self._limit = NO_LIMIT
        """Per row, what its total does not exceed when pods come to it."""
        self._rising: set[int] | None = None
        """All rows with a limit above their total, and perhaps others; None where these are many."""
        self._judged = False
        """Was it asked whether the columns allow it, since they or the nodes changed?"""
        self._patience = BoundsPayoff()

    def __repr__(self) -> str:
        return f"ScoreBounds({len(self.rows)} rows)"

    @property
    def allowed(self) -> bool:
        """May rows be doubted?"""
        return self._easy is not None

    # --- Putting off ---------------------------------------------------------------------------------------------

    def put_off(self, pod: PodInfo, full: Snapshot, verdicts: NodeToStatus, *, since: int, filtered: int) -> bool:
        """Doubt the rows that only took pods since then, and look at others that changed. False: all must be added up.

        `filtered` are the changes that may have made a difference to a filter, 0 when none did.
        """
        easy, news = self._easy, full.cluster.log.news(since, most=MOST_REPAIRED)
        if easy is None or news is None or not self._patient(news):
            return False
        if news.kinds & ~SAID_OF_PODS & (easy.interest | filtered):
            return False
        epochs, _ = bring_up(easy.others, pod, full, since)
        came, others = news.rows(_ADDED), news.rows(_OTHERWISE)
        if came is None or others is None or epochs + sum([each.epoch for each in easy.falling]) != self._sums.epochs:
            return False
        self._doubt(came)
        if filtered:
            others = [*others, *self._filter(came, verdicts)]
        if not others:
            return True
        self.rows.update(others)
        return self.look(pod, full.cluster, verdicts, [*dict.fromkeys(others)])

    def _patient(self, news: ChangeLogDelta) -> bool:
        if len(self.rows) > MOST_DOUBTS:
            return False
        patience = self._patience
        patience.begin(news.entries)
        if patience.pays:
            return True
        patience.added_up()
        self._give_up()
        return False

    def _doubt(self, rows: list[int]) -> None:
        """Pods came to these rows, and nothing else happened there."""
        ranking, limit = self._ranking, self._limit
        self.rows.update(rows)
        ranking.unsay(rows)
        total, rising = ranking.total, self._rising
        if rising is not None:
            rows = [row for row in rows if row in rising]
            rising.difference_update(rows)
        raised = [row for row in rows if limit.item(row) > total.item(row)]
        if raised:
            ranking.put(raised, [*map(limit.item, raised)])

    def _filter(self, rows: list[int], verdicts: NodeToStatus) -> list[int]:
        """Those of the rows that have become feasible; those that are not any more cannot be chosen."""
        total, reason = self._ranking.total, verdicts.reason
        changed = [row for row in rows if (reason.item(row) == 0) != (total.item(row) >= 0)]
        closed = [row for row in changed if reason.item(row) != 0]
        if closed:
            self._limit[closed] = INFEASIBLE
            self._ranking.put(closed, [INFEASIBLE] * len(closed))
        return [row for row in changed if reason.item(row) == 0]

    # --- Looking -------------------------------------------------------------------------------------------------

    def look(self, pod: PodInfo, cluster: Cache, verdicts: NodeToStatus, rows: list[int]) -> bool:
        """Add these rows up, which are in doubt; one that is not feasible stays so. False: it is quicker to add up all."""
        easy, sums, limit = self._easy, self._sums, self._limit
        self._patience.look(len(rows))
        if easy is None or self._patience.overtaxed:
            return False
        totals = []
        for row in rows:
            total = INFEASIBLE
            if verdicts.reason.item(row) == 0:
                self._ask(easy, pod, cluster, row)
                total = sums.add_row(row)
                self.rows.discard(row)
            limit[row] = most = easy.limit(total, row)
            if most > total and self._rising is not None:
                self._rising.add(row)
            totals.append(total)
        self._ranking.put(rows, totals)
        return True

    def _ask(self, easy: BoundedColumns, pod: PodInfo, cluster: Cache, row: int) -> None:
        there = cluster.nodes.rows.get(row)
        epochs = sum([column.look(pod, row, there) for column in easy.falling])
        if epochs:  # what was the same for all rows is not any more
            self._sums.epochs += epochs
            self._sums.sort()
            self._ranking.sights.clear()

    # --- Everything was added up -----------------------------------------------------------------------------------

    def heard(self, news: ChangeLogDelta | None) -> None:
        """Nodes may offer something else after these news, or after more than can be told."""
        if news is None or news.kinds & OFFERED:
            self._easy, self._judged = None, False

    def learn(self, pod: PodInfo, full: Snapshot) -> None:
        """All totals are true: from now on rows may be doubted, if the columns allow it."""
        if self._judged or self._patience.rest():
            return
        self._judged = True
        self._patience.added_up()
        self._easy = BoundedColumns.of(self._sums.live, pod, full)
        if self._easy is not None:
            total = self._ranking.total
            self._limit = self._easy.limits(total, slice(None))
            rising = (self._limit > total).nonzero()[0]
            self._rising = set(rising.tolist()) if len(rising) <= MOST_RISING else None

    def learn_rows(self, rows: Snapshot) -> None:
        """These rows have another total, a true one."""
        if self._easy is not None:
            self._limit[rows.rows] = self._easy.limits(self._ranking.total, rows.rows)
            if self._rising is not None:
                self._rising.update(rows.row_list)

    def forget(self) -> None:
        """All totals are others, perhaps those of other columns."""
        if self._easy is not None and len(self.rows) <= MOST_DOUBTS:
            self._give_up()
        self._easy, self._judged = None, False

    def settled(self) -> None:
        """Every row was added up, because too many had to be looked at or for another reason."""
        if self._easy is not None:
            if self._patience.overtaxed:
                self._give_up()
            self._patience.added_up()
        self.rows.clear()

    def _give_up(self) -> None:
        """For some time, unless it went well for long enough."""
        if self._patience.lose():
            self._easy, self._judged = None, False
