"""Scores that depend on one row alone: the weighted sum over the plugins that give them."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.explain.top_nodes import Scorers
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.runtime.filter_results import NodeToStatus
from robotapp_scheduler.core.runtime.incremental import FEW_ROWS, bring_up
from robotapp_scheduler.core.runtime.score_results import ScoreColumn


class ScoreParts(NamedTuple):
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
                alike={column.plugin.name: column.constant for column in live if column.constant is not None},
                apart=tuple(column.plugin.name for column in (*checked, *relative)),
            ),
            flat=flat,
            flats=np.array(flat, dtype=np.int64),
            weighted=[(column.plugin.weight, column) for column in checked if not column.plugin.shadow],
            checked=checked,
            relative=relative,
        )


NO_PARTS: Final = ScoreParts.of([])


EVERY: Final = slice(None)


class RowScores:
    """The columns of one class and their sum per row (`local`), feasible or not: added up once, mended row by row."""

    def __init__(self, columns: list[ScoreColumn]) -> None:
        self.columns = columns
        self.live = [column for column in columns if not column.skipped]
        """Those with an opinion about such pods."""
        self.parts = NO_PARTS
        self.local: IntArray = np.zeros(0, dtype=np.int64)
        self.epochs = -1
        """The sum of the columns' epochs when `parts` was made: another one makes everything out of date."""

    def __repr__(self) -> str:
        return f"RowScores({len(self.live)} plugins, {len(self.local)} rows)"

    def bring_up(self, pod: PodInfo, full: Snapshot, since: int) -> tuple[bool, ChangeLogDelta | None]:
        """Bring the columns to the head of the log. Are they summed up as before, and what happened since?"""
        epochs, news = bring_up(self.live, pod, full, since)
        if since < 0:
            # A plugin has no opinion because of the pod alone, so it need not be asked again for this class.
            self.live = [column for column in self.columns if not column.skipped]
            epochs = sum(column.epoch for column in self.live)
        same = epochs == self.epochs and len(self.local) == full.n
        self.epochs = epochs
        return same, news

    def sort(self) -> None:
        """Columns became constant, or ceased to be."""
        self.parts = ScoreParts.of(self.live)

    def add_all(self, rows: int) -> None:
        """Add up every row."""
        self.sort()
        sums = self._sums(EVERY)
        self.local = np.full(rows, self.parts.flat, dtype=np.int64) if sums is None else sums

    def add_rows(self, stale: Snapshot) -> None:
        """Add these rows up again."""
        if stale.n <= FEW_ROWS:
            for row in stale.row_list:
                self.add_row(row)
            return
        sums = self._sums(stale.rows)
        self.local[stale.rows] = self.parts.flat if sums is None else sums

    def add_row(self, row: int) -> int:
        """The same of one row. Answers its sum."""
        parts = self.parts
        total = parts.flat
        for weight, column in parts.weighted:
            total += weight * column.raw.item(row)
        self.local[row] = total
        return total

    def _sums(self, rows: npt.NDArray[np.intp] | slice) -> IntArray | None:
        """A new array of what these rows score, None when every row scores `flat`."""
        sums: IntArray | None = None
        for weight, column in self.parts.weighted:
            raw = column.raw[rows]
            part = raw if weight == 1 else weight * raw
            sums = part + self.parts.flats if sums is None else sums + part
        return sums

    def reject_bad(self, verdicts: NodeToStatus) -> bool:
        """Raises PluginError for a score that cannot be used. Was any left out because of one?"""
        found = False
        for column in self.parts.checked:
            if column.bad and not column.skipped:
                try:
                    column.check(verdicts.reason == 0)
                except PluginError as error:
                    self.forgive(column, error)
                    found = True
        return found

    def forgive(self, column: ScoreColumn, error: PluginError) -> None:
        """Raises the error unless the plugin is a shadow, which says nothing from then on."""
        if not column.plugin.shadow:
            raise error
        column.fail()
        self.sort()
