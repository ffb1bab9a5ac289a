"""How many pods per node match a label selector, kept up to date pod by pod once somebody asked.

A pod's labels are matched against a selector once per distinct label set, so 10,000 replicas cost one match.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
import numpy as np

from robotapp_api.values.selector import matches_labels
from robotapp_scheduler.core.columns import START_ROWS, IntArray, grown
from robotapp_scheduler.core.pods import PlacedPod

MOST_SELECTORS: Final = 256


class _Counter:
    """One (namespace, selector) pair: counts per row, and the verdict per label set."""

    __slots__ = ("column", "namespace", "selector", "verdicts")

    def __init__(self, namespace: str, selector: Mapping[str, Any], rows: int) -> None:
        self.namespace = namespace
        self.selector = selector
        self.column: IntArray = np.zeros(rows, dtype=np.int64)
        self.verdicts: dict[frozenset[tuple[str, str]], bool] = {}

    def counts(self, namespace: str, label_set: frozenset[tuple[str, str]]) -> bool:
        if namespace != self.namespace:
            return False
        verdict = self.verdicts.get(label_set)
        if verdict is None:
            verdict = matches_labels(self.selector, dict(label_set))
            self.verdicts[label_set] = verdict
        return verdict


class PodCounts:
    """Count columns per selector; terminating pods do not count."""

    def __init__(self) -> None:
        self._rows = START_ROWS
        self._counters: dict[tuple[str, bytes], _Counter] = {}
        self._sets: dict[tuple[str, frozenset[tuple[str, str]]], dict[int, int]] = {}

    def __repr__(self) -> str:
        return f"PodCounts({len(self._counters)} selectors, {len(self._sets)} label sets)"

    def count(self, row: int, record: PlacedPod, sign: int) -> None:
        """Count a pod in (+1) or out (-1)."""
        if record.terminating:
            return
        if row >= self._rows:
            self._grow(row + 1)
        label_set = frozenset(record.labels.items())
        rows = self._sets.setdefault((record.namespace, label_set), {})
        rows[row] = rows.get(row, 0) + sign
        if rows[row] == 0:
            del rows[row]
            if not rows:
                del self._sets[record.namespace, label_set]
        for counter in self._counters.values():
            if counter.counts(record.namespace, label_set):
                counter.column[row] += sign

    def column(self, namespace: str, selector: Mapping[str, Any], size: int) -> IntArray:
        """Matching pods of a namespace per row, for the first `size` rows."""
        if size > self._rows:
            self._grow(size)
        key = (namespace, msgspec.json.encode(selector, order="deterministic"))
        counter = self._counters.get(key)
        if counter is None:
            counter = self._build(key, _Counter(namespace, selector, self._rows))
        return counter.column[:size]

    def _build(self, key: tuple[str, bytes], counter: _Counter) -> _Counter:
        for (namespace, label_set), rows in self._sets.items():
            if counter.counts(namespace, label_set):
                for row, count in rows.items():
                    counter.column[row] += count
        if len(self._counters) >= MOST_SELECTORS:
            del self._counters[next(iter(self._counters))]
        self._counters[key] = counter
        return counter

    def _grow(self, rows: int) -> None:
        self._rows = max(rows, 2 * self._rows)
        for counter in self._counters.values():
            counter.column = grown(counter.column, self._rows).astype(np.int64, copy=False)
