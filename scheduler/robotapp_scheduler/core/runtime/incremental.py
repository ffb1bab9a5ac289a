"""Which rows of a cached column have to be computed again."""

from collections.abc import Iterable
from typing import Final

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.events.change_log import ChangeLogDelta
from robotapp_scheduler.core.events.cluster_event import CHANGES_OF_PODS, NODE_COMES_OR_GOES, Change
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo

MOST_REPAIRED: Final = 256
"""With more log entries than this a column is computed anew."""
FEW_ROWS: Final = 8
"""Up to so many rows, a sum of plain integers is faster than one of arrays."""
MOST_ROW_CALLS: Final = 6
"""Up to so many rows, `filter_row` and `score_row` for each are faster than `filter` and `score` for all."""
ANYTHING: Final = int(Change.ALL)


class Column:
    """A plugin's result for every row, valid up to `position` of the change log."""

    def __init__(self, plugin: RegisteredPlugin) -> None:
        self.plugin = plugin
        self.skipped = False
        """The plugin does not apply to such pods."""
        self.interest = plugin.interest
        """Kinds of change after which the changed rows must be computed again."""
        self.watches = plugin.watches
        """Kinds of change after which `refresh` must be called."""
        self.position = -1
        self.epoch = 0
        """Grows when the column was computed anew: combinations of columns must be computed anew, too."""

    def set_interest(self, interest: int) -> None:
        """Recompute rows after these kinds of change only."""
        self.interest, self.watches = interest, interest | NODE_COMES_OR_GOES

    def refresh(self, pod: PodInfo, full: Snapshot, delta: ChangeLogDelta | None) -> None:
        """Bring the column up to the head of the log. `delta` are the changes after `position`, None when there were too many."""
        raise NotImplementedError


def bring_up(columns: Iterable[Column], pod: PodInfo, full: Snapshot, since: int) -> tuple[int, ChangeLogDelta | None]:
    """Bring columns to the head of the log. `since` is the position at which the caller last combined them.

    Returns the sum of their epochs, and the delta since that position (None when too much happened).
    """
    log = full.cluster.log
    head, delta = log.position, log.delta(since, most=MOST_REPAIRED)
    kinds = delta.kinds if delta is not None else ANYTHING
    epochs = 0
    for column in columns:
        position = column.position
        if position != head:
            # The column is newer than `since`: what did not change after `since` did not change after the column.
            if not kinds & column.watches and since <= position <= head:
                column.position = head
            else:
                column.refresh(pod, full, delta if position == since else log.delta(position, most=MOST_REPAIRED))
        epochs += column.epoch
    return epochs, delta


def stale_rows(column: Column, pod: PodInfo, full: Snapshot, delta: ChangeLogDelta | None) -> Snapshot | None:
    """The rows of a cached column to compute again; None = all of them. Columns at the same position share the view."""
    if column.position < 0 or delta is None:
        return None
    rows, plugin = view_of(delta, column.interest, full.cluster), column.plugin
    if rows is None or not rows.n or plugin.row_local:
        return rows
    if delta.kinds & column.interest & ~CHANGES_OF_PODS:
        return None
    return rows if plugin.confined is not None and plugin.confined(pod, full, column.position) else None


def view_of(delta: ChangeLogDelta, interest: int, cluster: Cache) -> Snapshot | None:
    """The rows with a change of these kinds, None = all. Callers with the same delta and kinds share one view."""
    kinds = delta.kinds & interest
    view: Snapshot | None = delta.views.get(kinds)
    if view is None and (rows := delta.rows(kinds)) is not None:
        view = delta.views[kinds] = Snapshot(cluster, rows)
    return view
