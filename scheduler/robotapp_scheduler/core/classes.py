"""Cached results per pod class, repaired from the change log.

A *class* is everything any enabled plugin reads of a pod. Per plugin and value of its `reads` one column is kept (first
reason, or raw score, per row); per class their combination (first failing plugin per row, weighted total). Both remember
the position in the change log up to which they are true, so a pod of a known class costs the few rows that changed.
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from typing import Final, NamedTuple

from robotapp_scheduler.core.filter_column import FilterColumn, Reasons
from robotapp_scheduler.core.framework import Loaded
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.score_column import ScoreColumn, score_column

COLUMNS_PER_PLUGIN: Final = 32


class _Columns(NamedTuple):
    """What plugins that read the same said about pods that are equal in it, by their places in the profile."""

    filters: dict[int, FilterColumn]
    scores: dict[int, ScoreColumn]


class _Readers:
    """Plugins that read the same of a pod, and their columns by what that is; the least recently used ones are dropped."""

    def __init__(self, first: Loaded) -> None:
        self.filters: dict[int, Loaded] = {}
        self.scores: dict[int, Loaded] = {}
        self._reads, self._live = first.reads, first.reads_live
        self._columns: OrderedDict[Hashable, _Columns] = OrderedDict()

    def columns(self, pod: PodInfo, reasons: Reasons) -> _Columns:
        """The columns for pods like this one."""
        key = pod.live_features(self._reads) if self._live else pod.features(self._reads)
        found = self._columns.get(key)
        if found is not None:
            self._columns.move_to_end(key)
            return found
        found = self._columns[key] = _Columns(
            {place: FilterColumn(plugin, reasons) for place, plugin in self.filters.items()},
            {place: score_column(plugin) for place, plugin in self.scores.items()},
        )
        for verdicts in found.filters.values():
            verdicts.mind(verdicts.plugin.interest_for(pod))
        for scores in found.scores.values():
            scores.mind(scores.plugin.interest_for(pod))
        if len(self._columns) > COLUMNS_PER_PLUGIN:
            self._columns.popitem(last=False)
        return found


class ColumnCache:
    """Columns of plugins, found by what these read of a pod: once for all that read the same."""

    def __init__(self, reasons: Reasons, filters: Sequence[Loaded], scores: Sequence[Loaded]) -> None:
        self._reasons = reasons
        self._filters, self._scores = range(len(filters)), range(len(scores))
        readers: dict[tuple[str, ...], _Readers] = {}
        for plugin in (*filters, *scores):
            if plugin.reads not in readers:
                readers[plugin.reads] = _Readers(plugin)
        for place, plugin in enumerate(filters):
            readers[plugin.reads].filters[place] = plugin
        for place, plugin in enumerate(scores):
            readers[plugin.reads].scores[place] = plugin
        self._readers = list(readers.values())

    def of(self, pod: PodInfo) -> tuple[list[FilterColumn], list[ScoreColumn]]:
        """The columns of all filters and of all scores for pods like this one, in the order of the plugins."""
        filters: dict[int, FilterColumn] = {}
        scores: dict[int, ScoreColumn] = {}
        for readers in self._readers:
            found = readers.columns(pod, self._reasons)
            filters |= found.filters
            scores |= found.scores
        return [*map(filters.__getitem__, self._filters)], [*map(scores.__getitem__, self._scores)]
