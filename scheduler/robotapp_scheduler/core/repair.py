"""Which rows of a cached column have to be computed again."""

from typing import Final

from robotapp_scheduler.core.changes import PLACED
from robotapp_scheduler.core.framework import Loaded
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes

MOST_REPAIRED: Final = 48
"""With more log entries than this a column is computed anew: the vector form costs as much as ~50 single rows."""
FEW_ROWS: Final = 8
"""Up to here plain integers beat arrays."""
_PLACED: Final = int(PLACED)


def stale_rows(plugin: Loaded, position: int, pod: PodInfo, full: Nodes, *, fits: bool) -> list[int] | None:
    """Rows of a cached column to compute again; None = all of them."""
    if position < 0 or not fits:
        return None
    log = full.cluster.log
    rows = log.since(position, plugin.interest, most=MOST_REPAIRED)
    if not rows or plugin.row_local:
        return rows
    if plugin.confined is None or log.since(position, plugin.interest & ~_PLACED, most=MOST_REPAIRED) != []:
        return None
    return rows if plugin.confined(pod, full, position) else None
