"""Cached results per pod class, repaired from the change log.

A *class* is everything any enabled plugin reads of a pod. Per plugin and value of its `reads` one column is kept (first
reason, or raw score, per row); per class their combination (first failing plugin per row, weighted total). Both remember
the position in the change log up to which they are true, so a pod of a known class costs the few rows that changed.
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence
from typing import Final, NamedTuple

from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import OWN_FEATURES, VOLUME_FEATURE, PodInfo
from robotapp_scheduler.core.runtime.filter_results import FilterColumn, Reasons
from robotapp_scheduler.core.runtime.score_results import ScoreColumn, score_column

COLUMNS_PER_PLUGIN: Final = 32
VARIED: Final = frozenset({"requests", "labels", "controller", "images", *OWN_FEATURES}) - {"node_name"}
"""In these the pods of one workload differ from those of the next; in the others most pods of a cluster are equal."""


class _Columns(NamedTuple):
    """What plugins that read the same said about pods that are equal in it, by their places in the profile."""

    filters: dict[int, FilterColumn]
    scores: dict[int, ScoreColumn]


class _Readers:
    """Plugins that read the same of a pod, and their columns by what that is; the least recently used ones are dropped."""

    def __init__(self, first: RegisteredPlugin) -> None:
        self.filters: dict[int, RegisteredPlugin] = {}
        self.scores: dict[int, RegisteredPlugin] = {}
        self.reads, self.live = first.reads, first.reads_live
        self._columns: OrderedDict[Hashable, _Columns] = OrderedDict()

    def columns(self, pod: PodInfo, reasons: Reasons) -> _Columns:
        """The columns for pods like this one."""
        key = pod.live_features(self.reads) if self.live else pod.features(self.reads)
        found = self._columns.get(key)
        if found is not None:
            self._columns.move_to_end(key)
            return found
        found = _Columns(
            {place: FilterColumn(plugin, reasons) for place, plugin in self.filters.items()},
            {place: score_column(plugin) for place, plugin in self.scores.items()},
        )
        for verdicts in found.filters.values():
            verdicts.mind(verdicts.plugin.interest_for(pod))
        for scores in found.scores.values():
            scores.mind(scores.plugin.interest_for(pod))
        self._columns[key] = found  # last: a plugin that cannot say what it minds is asked again
        if len(self._columns) > COLUMNS_PER_PLUGIN:
            self._columns.popitem(last=False)
        return found


class _CommonReaders:
    """Readers of what most pods have in common: a new class usually finds all their columns in one look."""

    def __init__(self, readers: Sequence[_Readers]) -> None:
        self._readers = readers
        self._static = tuple(sorted({name for each in readers if not each.live for name in each.reads}))
        self._ros = tuple(sorted({name for each in readers if each.live for name in each.reads} - {VOLUME_FEATURE}))
        self._known: OrderedDict[Hashable, _Columns] = OrderedDict()

    def columns(self, pod: PodInfo, reasons: Reasons) -> _Columns:
        """Their columns for pods like this one."""
        key = (pod.features(self._static), pod.live_features(self._ros), pod.volume_key)
        known = self._known.get(key)
        if known is not None:
            self._known.move_to_end(key)
            return known
        known = _Columns({}, {})
        for readers in self._readers:
            found = readers.columns(pod, reasons)
            known.filters.update(found.filters)
            known.scores.update(found.scores)
        self._known[key] = known
        if len(self._known) > COLUMNS_PER_PLUGIN:
            self._known.popitem(last=False)
        return known


class ColumnCache:
    """Columns of plugins, found by what these read of a pod: once for all that read the same."""

    def __init__(
        self, reasons: Reasons, filters: Sequence[RegisteredPlugin], scores: Sequence[RegisteredPlugin]
    ) -> None:
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
        self._apart = [each for each in readers.values() if not VARIED.isdisjoint(each.reads)]
        self._alike = _CommonReaders([each for each in readers.values() if VARIED.isdisjoint(each.reads)])

    def of(self, pod: PodInfo) -> tuple[list[FilterColumn], list[ScoreColumn]]:
        """The columns of all filters and of all scores for pods like this one, in the order of the plugins."""
        alike = self._alike.columns(pod, self._reasons)
        filters, scores = dict(alike.filters), dict(alike.scores)
        for readers in self._apart:
            found = readers.columns(pod, self._reasons)
            filters |= found.filters
            scores |= found.scores
        return [*map(filters.__getitem__, self._filters)], [*map(scores.__getitem__, self._scores)]
