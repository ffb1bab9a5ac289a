"""Which rows of a cached column have to be computed again."""

from typing import Final

from robotapp_scheduler.core.changes import PLACED, News
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.framework import Loaded
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.view import Nodes

MOST_REPAIRED: Final = 256
"""With more log entries than this a column is computed anew."""
FEW_ROWS: Final = 8
"""Up to here plain integers beat arrays."""
_PLACED: Final = int(PLACED)


def stale_rows(plugin: Loaded, position: int, pod: PodInfo, full: Nodes, *, fits: bool) -> Nodes | None:
    """The rows of a cached column to compute again; None = all of them. Columns that stand together share the view."""
    if position < 0 or not fits:
        return None
    news = full.cluster.log.news(position, most=MOST_REPAIRED)
    if news is None:
        return None
    kinds = news.kinds & plugin.interest
    rows = view_of(news, kinds, full.cluster)
    if rows is None or not rows.n or plugin.row_local:
        return rows
    if kinds & ~_PLACED:
        return None
    if plugin.untouched is not None and plugin.untouched(pod, full, position):
        return Nodes(full.cluster, ())
    return rows if plugin.confined is not None and plugin.confined(pod, full, position) else None


def view_of(news: News, interest: int, cluster: Cluster) -> Nodes | None:
    """The rows with a change of interest, None = all; one view for all who ask."""
    kinds = news.kinds & interest
    view: Nodes | None = news.views.get(kinds)
    if view is None and (rows := news.rows(kinds)) is not None:
        view = news.views[kinds] = Nodes(cluster, rows)
    return view
