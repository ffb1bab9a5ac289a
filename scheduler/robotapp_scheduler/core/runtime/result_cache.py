"""Keeps evaluations and columns of plugins by what plugins read of a pod; drops the least recently used ones."""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Any, Final

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import FEATURES, LIVE, OWN_FEATURES, PodInfo
from robotapp_scheduler.core.runtime.evaluation import Evaluation
from robotapp_scheduler.core.runtime.filter_results import FilterColumn, Reasons
from robotapp_scheduler.core.runtime.incremental import Column
from robotapp_scheduler.core.runtime.score_results import ScoreColumn, score_column

COLUMNS_PER_PLUGIN: Final = 32
CLASS_BYTES: Final = 100_000_000
BYTES_PER_ROW: Final = 300
"""What a class with columns of its own costs per node, at worst."""
MOST_REMEMBERED: Final = 16


_Columns = tuple[dict[int, FilterColumn], dict[int, ScoreColumn]]
"""Columns of filters and of scores that read the same of a pod, by the plugins' places in the profile."""


class _Readers:
    """Plugins that read the same of a pod, and their columns by what that is."""

    def __init__(self, first: RegisteredPlugin) -> None:
        self.filters: dict[int, RegisteredPlugin] = {}
        self.scores: dict[int, RegisteredPlugin] = {}
        self._reads, self._live = first.reads, first.reads_live
        self._columns: OrderedDict[Hashable, _Columns] = OrderedDict()

    def columns(self, pod: PodInfo, reasons: Reasons) -> _Columns:
        """The columns for pods like this one."""
        key = pod.live_features(self._reads) if self._live else pod.features(self._reads)
        found = self._columns.get(key)
        if found is not None:
            self._columns.move_to_end(key)
            return found
        filters = {place: FilterColumn(plugin, reasons) for place, plugin in self.filters.items()}
        scores = {place: score_column(plugin) for place, plugin in self.scores.items()}
        columns: Iterable[Column] = (*filters.values(), *scores.values())
        for column in columns:
            column.set_interest(column.plugin.interest_for(pod))
        found = self._columns[key] = (
            filters,
            scores,
        )  # last: when `minds` raises, it is called again for the next such pod
        if len(self._columns) > COLUMNS_PER_PLUGIN:
            self._columns.popitem(last=False)
        return found


class ColumnCache:
    """Columns of plugins by what these read of a pod. Plugins with equal `reads` share one look-up."""

    def __init__(
        self, reasons: Reasons, filters: Sequence[RegisteredPlugin], scores: Sequence[RegisteredPlugin]
    ) -> None:
        self._reasons = reasons
        self._filters, self._scores = range(len(filters)), range(len(scores))
        readers: dict[tuple[str, ...], _Readers] = {}
        for place, plugin in enumerate(filters):
            readers.setdefault(plugin.reads, _Readers(plugin)).filters[place] = plugin
        for place, plugin in enumerate(scores):
            readers.setdefault(plugin.reads, _Readers(plugin)).scores[place] = plugin
        self._readers = [*readers.values()]

    def of(self, pod: PodInfo) -> tuple[list[FilterColumn], list[ScoreColumn]]:
        """The columns of all filters and of all scores for pods like this one, in the order of the plugins."""
        filters: dict[int, FilterColumn] = {}
        scores: dict[int, ScoreColumn] = {}
        for readers in self._readers:
            more_filters, more_scores = readers.columns(pod, self._reasons)
            filters |= more_filters
            scores |= more_scores
        return [*map(filters.__getitem__, self._filters)], [*map(scores.__getitem__, self._scores)]


class ResultCache:
    """The evaluations of one profile by pod class, over columns that classes share. `dropped` is called with each that goes.

    A class is everything that any plugin of the profile reads of a pod.
    """

    def __init__(self, profile: Profile, cluster: Cache, dropped: Callable[[Evaluation], None]) -> None:
        self.reasons = Reasons()
        self._profile, self._cluster, self._dropped = profile, cluster, dropped
        self._columns = ColumnCache(self.reasons, profile.filters, profile.scores)
        self._shadows = ColumnCache(self.reasons, profile.shadow_filters, ())
        self._evaluations: OrderedDict[Hashable, Evaluation] = OrderedDict()
        self._remembered: OrderedDict[Hashable, dict[Any, Any]] = OrderedDict()
        static = [name for name in profile.reads if not name.startswith(LIVE)]
        self._shape_reads = tuple(name for name in static if name not in OWN_FEATURES)
        self._own_reads = tuple(FEATURES[name] for name in static if name in OWN_FEATURES)

    def __repr__(self) -> str:
        return f"ResultCache({len(self)} classes)"

    def __len__(self) -> int:
        return len(self._evaluations)

    def __iter__(self) -> Iterator[Evaluation]:
        return iter(self._evaluations.values())

    def evaluation(self, pod: PodInfo) -> Evaluation:
        """That of the pod's class; empty for a new class."""
        key = self._key(pod)
        evaluation = self._evaluations.get(key)
        if evaluation is not None:
            self._evaluations.move_to_end(key)
            return evaluation
        evaluation = self._evaluations[key] = Evaluation(*self._columns.of(pod), self.reasons)
        if len(self) > self._most_classes():
            self._dropped(self._evaluations.popitem(last=False)[1])
        return evaluation

    def uncached(self) -> Evaluation:
        """An empty evaluation with columns of its own, which is not kept."""
        filters = [FilterColumn(plugin, self.reasons) for plugin in self._profile.filters]
        return Evaluation(filters, [score_column(plugin) for plugin in self._profile.scores], self.reasons)

    def shadow_filters(self, pod: PodInfo) -> list[FilterColumn]:
        """The columns of the filters that are called without effect."""
        return self._shadows.of(pod)[0]

    def remembered(self, pod: PodInfo, key: Hashable) -> dict[Any, Any]:
        """A dictionary in which a post_filter keeps results for pods of this class."""
        full = (self._key(pod), key)
        found = self._remembered.setdefault(full, {})
        self._remembered.move_to_end(full)
        if len(self._remembered) > MOST_REMEMBERED:
            self._remembered.popitem(last=False)
        return found

    def _key(self, pod: PodInfo) -> Hashable:
        own = [feature(pod) for feature in self._own_reads]
        return (pod.features(self._shape_reads), *own, pod.ros, pod.volume_key, pod.claims and pod.claims.key)

    def _most_classes(self) -> int:
        size = max(self._cluster.nodes.size, 1)
        return max(32, min(512, CLASS_BYTES // (BYTES_PER_ROW * size)))
