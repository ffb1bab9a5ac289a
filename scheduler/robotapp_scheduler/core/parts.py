"""The score columns of one pod class, by how they go into its totals."""

from typing import Final, NamedTuple

import numpy as np

from robotapp_scheduler.core.explain.top_nodes import Scorers
from robotapp_scheduler.core.nodes.columns import IntArray
from robotapp_scheduler.core.score_column import ScoreColumn


class Parts(NamedTuple):
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
    def of(cls, columns: list[ScoreColumn]) -> "Parts":
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


NO_PARTS: Final = Parts.of([])
