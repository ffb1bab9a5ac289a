"""Rows that only took pods since they were added up: a bound stands for their total until they come up as the best.

Where several classes take turns, each finds some twenty rows that the others have used. To add all of them up again costs
as much as the rest of a decision, and most change once more before anybody asks for them. What such a row scores can
fall, or rise to the ceiling its plugins name: it is true enough while it stays below those that are chosen.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.changes import NODE, PLACED, Change, News
from robotapp_scheduler.core.columns import IntArray
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.score_column import RelativeColumn, ScoreColumn
from robotapp_scheduler.core.view import Nodes

MOST_DOUBTS: Final = 1024
"""Rows; with more than these all are added up."""
MOST_LOOKS: Final = 8
"""Rows looked at one by one in one decision, before all are added up: in columns they cost a third each."""
SOON: Final = 32
"""When all must be added up after fewer decisions than this, though few rows were in doubt, it does not pay."""
WINDOW: Final = 16
"""Decisions after which is asked whether it pays."""
REST: Final = 16
"""Decisions until it is tried again; twice as many after each time that it did not pay."""
MOST_REST: Final = 4096
NOTHING: Final = np.array(0, dtype=np.int64)
NO_LIMIT: Final[IntArray] = np.zeros(0, dtype=np.int64)
_ADDED: Final = int(Change.POD_ADDED)
_OTHERWISE: Final = int(PLACED & ~Change.POD_ADDED)
_OFFERED: Final = int(NODE | Change.ALLOCATABLE)
_OF_PODS: Final = int(PLACED | Change.TERMS)


Ceilings = dict[ScoreColumn, IntArray | int | None]


class Easy(NamedTuple):
    """Columns of one class, by how they take it when a pod comes to a row."""

    falling: list[ScoreColumn]
    """They fall, or rise to a ceiling."""
    others: list[ScoreColumn]
    """They say the same as before, or must be asked."""
    interest: int
    """Changes after which rows must be looked at though no pod came there."""
    ceilings: list[tuple[int, ScoreColumn, IntArray | int]]
    """With the weight, where the ceiling is above 0."""

    @classmethod
    def of(cls, columns: Sequence[ScoreColumn], pod: PodInfo, full: Nodes, known: Ceilings) -> "Easy | None":
        """None when a row must be added up after each pod. `known` are ceilings that are true still; others are added."""
        falling, others, ceilings, interest = [], [], [], 0
        if any(column.plugin.shadow or not column.local for column in columns):
            return None
        for column in columns:
            if column not in known and column.watches & _OF_PODS:
                known[column] = _ceiling(column, pod, full)
            ceiling = known.get(column)
            if ceiling is not None:
                falling.append(column)
                interest |= column.interest
                if not isinstance(ceiling, int) or ceiling > 0:
                    ceilings.append((column.plugin.weight, column, ceiling))
            elif column.constant is None and column.watches & _OF_PODS:
                return None
            else:
                others.append(column)
                if column.constant is None:
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


def _ceiling(column: ScoreColumn, pod: PodInfo, full: Nodes) -> IntArray | int | None:
    plugin = column.plugin
    if plugin.ceiling is None or plugin.score_row is None or not plugin.row_local or isinstance(column, RelativeColumn):
        return None
    if column.normalize != "none" or column.bad:
        return None
    return plugin.ceiling(pod, full)


class Doubts:
    """The rows of one class whose total is a bound, while its columns allow it."""

    def __init__(self) -> None:
        self.rows: set[int] = set()
        self.easy: Easy | None = None
        self.limit = NO_LIMIT
        """Per row, what its total does not exceed when pods come to it."""
        self.ceilings: Ceilings = {}
        """As far as they are known."""
        self.looks = 0
        """Rows looked at one by one in this decision."""
        self.judged = False
        """Was it asked whether its columns allow it, since they or the nodes changed?"""
        self._pause, self._rest = 0, REST
        self._decisions = 0
        """Since all rows were added up."""
        self._came = self._looked = 0
        """Changes, and rows looked at one by one, in this window."""

    def __repr__(self) -> str:
        return f"Doubts({len(self.rows)} rows)"

    def forget(self) -> None:
        """All totals are others, perhaps those of other columns."""
        if self.easy is not None and len(self.rows) <= MOST_DOUBTS:
            self._give_up()
        self.easy, self.judged = None, False

    def heard(self, news: News | None) -> None:
        """Nodes may offer something else after these news, or after more than can be told."""
        if news is None or news.kinds & _OFFERED:
            self.ceilings.clear()
            self.easy, self.judged = None, False

    def settled(self) -> None:
        """Every row was added up, because too many had to be looked at or for another reason."""
        if self.easy is not None and self.looks > MOST_LOOKS:
            self._give_up()
        self._decisions = 0

    def _give_up(self) -> None:
        """For some time, unless it went well for long enough."""
        if self._decisions < SOON:
            self._pause = self._rest
            self._rest = min(2 * self._rest, MOST_REST)
            self.easy, self.judged = None, False
            self.ceilings.clear()
        else:
            self._rest = REST
        self._came = self._looked = 0

    def _pays(self, came: int) -> bool:
        """Of the rows that changed, were at most half looked at one by one? Pods may come to the best rows only."""
        self._came += came
        self._looked += self.looks
        self.looks = 0
        self._decisions += 1
        if self._decisions % WINDOW:
            return True
        pays = 2 * self._looked <= self._came
        self._came = self._looked = 0
        return pays

    def learn(self, columns: Sequence[ScoreColumn], pod: PodInfo, full: Nodes, total: IntArray) -> None:
        """All `total` are true: from now on rows may be doubted, if these columns allow it."""
        if self._pause:
            self._pause -= 1
            return
        self.judged, self._decisions = True, 0
        self.easy = Easy.of(columns, pod, full, self.ceilings)
        if self.easy is not None:
            self.limit = self.easy.limits(total, slice(0, len(total)))

    def learn_rows(self, easy: Easy, total: IntArray, rows: Nodes) -> None:
        """These rows have another total, a true one."""
        self.limit[rows.rows] = easy.limits(total, rows.rows)

    def allowed(self, news: News, *, verdicts: int) -> "Easy | None":
        """May rows be doubted after this? `verdicts` are the changes that may have made a difference to a filter."""
        if self.easy is None or len(self.rows) > MOST_DOUBTS:
            return None
        if not self._pays(news.entries):
            self._decisions = 0
            self._give_up()
            return None
        other = news.kinds & ~_OF_PODS
        if other & (self.easy.interest | verdicts):
            return None
        return self.easy


def rows_of(news: News) -> tuple[list[int], list[int]] | None:
    """Rows that pods came to, and rows where something else happened to pods; None when that is everywhere."""
    came, others = news.rows(_ADDED), news.rows(_OTHERWISE)
    return None if came is None or others is None else (came, others)
