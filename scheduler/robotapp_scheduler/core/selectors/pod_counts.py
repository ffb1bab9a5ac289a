"""Counts of the placed pods that match a selector, per node row and per topology domain, kept up to date after the first use."""

from collections import OrderedDict
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from robotapp_scheduler.core.nodes.columns import START_ROWS, IntArray, LabelColumns, grown
from robotapp_scheduler.core.selectors.label_sets import LabelSet, LabelSets
from robotapp_scheduler.core.selectors.pod_matcher import ByLabel, PodMatcher
from robotapp_scheduler.core.selectors.topology_domains import Domains, Scope

MOST_COUNTERS: Final = 256
MOST_DOMAINS: Final = 16
"""Per counter: topology keys times inclusion policies in use."""


class Census(StrEnum):
    """Which of the matching pods count."""

    ALL = "all"
    """Terminating ones too (pod affinity)."""
    ALIVE = "alive"
    """Terminating ones not."""
    SPREAD = "spread"
    """As ALIVE, and a selector without any expression counts none; a dry run counts them, as kube-scheduler does."""


class Wanted(NamedTuple):
    """What a counter counts: pods that match all of these matchers."""

    matchers: tuple[PodMatcher, ...]
    census: Census

    def matches(self, label_set: LabelSet) -> bool:
        """Does it count pods with these labels?"""
        return all(matcher.matches(label_set.namespace, label_set.labels) for matcher in self.matchers)

    @property
    def blank(self) -> bool:
        """A spread constraint with the selector {}."""
        return self.census is Census.SPREAD and all(matcher.requirements == () for matcher in self.matchers)


class Counter:
    """Matching pods per row, and per domain of the topology keys that plugins have read."""

    __slots__ = ("_domains", "_labels", "blank", "census", "column", "wanted")

    def __init__(self, wanted: Wanted, labels: LabelColumns, rows: int) -> None:
        self.wanted = wanted
        self.census = wanted.census
        self.blank = wanted.blank
        self.column: IntArray = np.zeros(rows, dtype=np.int64)
        self._labels = labels
        self._domains: OrderedDict[tuple[str, Scope | None], Domains] = OrderedDict()

    def __repr__(self) -> str:
        return f"Counter({self.wanted}, {int(self.column.sum())} pods)"

    def add(self, row: int, amount: int) -> None:
        """Pods on a row came (positive) or went."""
        self.column[row] += amount
        for domains in self._domains.values():
            domains.add(row, amount)

    def domains(self, key: str, scope: Scope | None = None) -> Domains:
        """The counts per value of a node label, of the rows in scope."""
        found = self._domains.get((key, scope))
        if found is None:
            found = self._domains[key, scope] = Domains(self._labels, key, scope)
            if len(self._domains) > MOST_DOMAINS:
                self._domains.popitem(last=False)
        if found.stale:
            found.renew(self.column)
        return found

    def count_placed(self, label_set: LabelSet) -> None:
        """Count the pods of a label set that are placed already."""
        if self.blank:
            return
        for row, count in label_set.rows.items():
            self.column[row] += count
        if self.census is not Census.ALL:
            for row, count in label_set.ending.items():
                self.column[row] -= count


class PodCounts:
    """Counters by what they count; the least recently used ones are dropped."""

    def __init__(self, label_sets: LabelSets, labels: LabelColumns) -> None:
        self._rows = START_ROWS
        self._label_sets = label_sets
        self._labels = labels
        self._counters: OrderedDict[Wanted, Counter] = OrderedDict()
        self._by_label: ByLabel[Counter] = ByLabel()
        self._dry_run: list[Counter] | None = None
        """Counters made during a dry run; None outside."""

    def __repr__(self) -> str:
        return f"PodCounts({len(self._counters)} counters, {len(self._label_sets)} label sets)"

    def enrol(self, label_set: LabelSet) -> None:
        """A label set is new: find the counters that count it."""
        found = dict.fromkeys(self._by_label.candidates(label_set.labels))
        label_set.counters = tuple(counter for counter in found if counter.wanted.matches(label_set))

    def begin_dry_run(self) -> None:
        """From now on pods are moved only for a dry run of preemption."""
        self._dry_run = []

    def end_dry_run(self) -> None:
        """All moves are undone. Counters made meanwhile are dropped: they began in the middle of the moves."""
        for counter in self._dry_run or ():
            if self._counters.pop(counter.wanted, None) is counter:
                self._drop(counter)
        self._dry_run = None

    def count(self, row: int, label_set: LabelSet, sign: int, *, ending: bool) -> None:
        """Count a pod in (+1) or out (-1)."""
        if row >= self._rows:
            self._grow(row + 1)
        label_set.count(row, sign, ending=ending)
        for counter in label_set.counters:
            if counter.census is not Census.ALL:
                ignored = counter.blank or ending
                if ignored and (self._dry_run is None or counter.census is not Census.SPREAD):
                    continue
            counter.add(row, sign)

    def counter(self, wanted: Wanted, size: int) -> Counter:
        """The counter of these pods, with a column of at least `size` rows."""
        if size > self._rows:
            self._grow(size)
        counter = self._counters.get(wanted)
        if counter is None:
            return self._build(wanted)
        self._counters.move_to_end(wanted)
        return counter

    def _build(self, wanted: Wanted) -> Counter:
        counter = self._counters[wanted] = Counter(wanted, self._labels, self._rows)
        first = wanted.matchers[0]
        if first.requirements is not None:
            self._by_label.add(counter, first.requirements)
        for label_set in self._label_sets.matching(first):
            if wanted.matches(label_set):
                counter.count_placed(label_set)
                label_set.counters = (*label_set.counters, counter)
        if self._dry_run is not None:
            self._dry_run.append(counter)
        if len(self._counters) > MOST_COUNTERS:
            self._drop(self._counters.popitem(last=False)[1])
        return counter

    def _drop(self, counter: Counter) -> None:
        first = counter.wanted.matchers[0]
        if first.requirements is not None:
            self._by_label.remove(counter, first.requirements)
        for label_set in self._label_sets.matching(first):
            label_set.counters = tuple(each for each in label_set.counters if each is not counter)

    def _grow(self, rows: int) -> None:
        self._rows = max(rows, 2 * self._rows)
        for counter in self._counters.values():
            counter.column = grown(counter.column, self._rows).astype(np.int64, copy=False)
