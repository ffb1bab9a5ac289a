"""Cached results per pod class, repaired from the change log.

A *class* is everything any enabled plugin reads of a pod. Per plugin and value of its `reads` one column is kept (first
reason, or raw score, per row); per class their combination (first failing plugin per row, weighted total). Both remember
the position in the change log up to which they are true, so a pod of a known class costs the few rows that changed.
"""

from collections import OrderedDict
from collections.abc import Hashable
from typing import Final

from robotapp_scheduler.core.filter_column import FilterColumn, Reasons
from robotapp_scheduler.core.framework import Loaded
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.score_column import ScoreColumn, score_column

COLUMNS_PER_PLUGIN: Final = 32


class ColumnCache:
    """Columns of all plugins of one profile, least recently used ones dropped per plugin."""

    def __init__(self, reasons: Reasons) -> None:
        self._reasons = reasons
        self._filters: dict[str, OrderedDict[Hashable, FilterColumn]] = {}
        self._scores: dict[str, OrderedDict[Hashable, ScoreColumn]] = {}

    def filter(self, plugin: Loaded, pod: PodInfo) -> FilterColumn:
        """The column of a filter plugin for pods like this one."""
        columns = self._filters.setdefault(plugin.name, OrderedDict())
        key = pod.live_features(plugin.reads) if plugin.reads_live else pod.features(plugin.reads)
        column = columns.get(key)
        if column is None:
            column = columns[key] = FilterColumn(plugin, self._reasons)
            column.mind(plugin.interest_for(pod))
            if len(columns) > COLUMNS_PER_PLUGIN:
                columns.popitem(last=False)
        else:
            columns.move_to_end(key)
        return column

    def score(self, plugin: Loaded, pod: PodInfo) -> ScoreColumn:
        """The column of a score plugin for pods like this one."""
        columns = self._scores.setdefault(plugin.name, OrderedDict())
        key = pod.live_features(plugin.reads) if plugin.reads_live else pod.features(plugin.reads)
        column = columns.get(key)
        if column is None:
            column = columns[key] = score_column(plugin)
            column.mind(plugin.interest_for(pod))
            if len(columns) > COLUMNS_PER_PLUGIN:
                columns.popitem(last=False)
        else:
            columns.move_to_end(key)
        return column
