"""Placed pods by namespace and labels: a selector is matched once per distinct label set, not once per pod."""

from collections.abc import Iterator, Mapping
from typing import Any

from robotapp_scheduler.core.selectors.pod_matcher import PodMatcher, handle

LabelSetKey = tuple[str, frozenset[tuple[str, str]]]


def label_key(namespace: str, labels: Mapping[str, str]) -> LabelSetKey:
    """Key of a label set: equal for pods of one namespace with the same labels."""
    return namespace, frozenset(labels.items())


class LabelSet:
    """The placed pods of a namespace with exactly these labels, and on which rows they are."""

    __slots__ = ("counters", "ending", "labels", "namespace", "pods", "rows")

    def __init__(self, namespace: str, labels: dict[str, str]) -> None:
        self.namespace = namespace
        self.labels = labels
        """Shared by all its pods."""
        self.pods = 0
        """Placed pods, including those on nodes that are not in the cache."""
        self.rows: dict[int, int] = {}
        """Pods per row, terminating ones included."""
        self.ending: dict[int, int] = {}
        """Of these, terminating."""
        self.counters: tuple[Any, ...] = ()
        """Counters (core.selectors.pod_counts) that count these pods."""

    def __repr__(self) -> str:
        return f"LabelSet({self.namespace}, {self.labels}, {self.pods} pods)"

    def count(self, row: int, sign: int, *, ending: bool) -> None:
        """Count a pod in (+1) or out (-1)."""
        rows = self.rows
        count = rows[row] = rows.get(row, 0) + sign
        if not count:
            del rows[row]
        if ending:
            _add(self.ending, row, sign)


class LabelSets:
    """All label sets in use."""

    __slots__ = ("_by_dict", "_by_key", "_by_label", "_latest")

    def __init__(self) -> None:
        self._by_key: dict[LabelSetKey, LabelSet] = {}
        self._by_dict: dict[int, LabelSet] = {}
        """By id() of the labels, which all its pods share."""
        self._latest = LabelSet("", {})
        self._by_label: dict[str, dict[str, dict[LabelSet, None]]] = {}
        """Label key → value → label sets, for keys that a selector has named."""

    def __repr__(self) -> str:
        return f"LabelSets({len(self._by_key)})"

    def __len__(self) -> int:
        return len(self._by_key)

    def take(self, namespace: str, labels: dict[str, str]) -> tuple[LabelSet, bool]:
        """The label set of a pod that was placed, and whether it is new."""
        shared = self._by_dict.get(id(labels))
        if shared is not None and shared.namespace == namespace:
            shared.pods += 1
            return shared, False
        latest = self._latest
        # Replicas come one after the other.
        if latest.pods and latest.namespace == namespace and latest.labels == labels:
            latest.pods += 1
            return latest, False
        key = label_key(namespace, labels)
        found = self._by_key.get(key)
        new = found is None
        if found is None:
            found = self._by_key[key] = self._by_dict[id(labels)] = LabelSet(namespace, labels)
            for name, by_value in self._by_label.items():
                if (value := labels.get(name)) is not None:
                    by_value.setdefault(value, {})[found] = None
        found.pods += 1
        self._latest = found
        return found, new

    def like(self, namespace: str, labels: dict[str, str]) -> dict[str, str] | None:
        """Equal labels that placed pods of the namespace share; None when there are no such pods."""
        found = self._by_key.get(label_key(namespace, labels))
        return found.labels if found is not None else None

    def release(self, label_set: LabelSet) -> None:
        """A pod of this label set is no longer placed."""
        label_set.pods -= 1
        if label_set.pods:
            return
        del self._by_key[label_key(label_set.namespace, label_set.labels)]
        if self._by_dict.get(id(label_set.labels)) is label_set:  # not of another namespace
            del self._by_dict[id(label_set.labels)]
        for name, by_value in self._by_label.items():
            if (value := label_set.labels.get(name)) is not None:
                del by_value[value][label_set]
                if not by_value[value]:
                    del by_value[value]

    def matching(self, matcher: PodMatcher) -> Iterator[LabelSet]:
        """Label sets whose pods match."""
        if matcher.requirements is None:
            return
        found = handle(matcher.requirements)
        if found is None:
            candidates: list[LabelSet] = list(self._by_key.values())
        else:
            by_value = self._values_of(found[0])
            candidates = [each for value in found[1] for each in by_value.get(value, ())]
        for label_set in candidates:
            if matcher.matches(label_set.namespace, label_set.labels):
                yield label_set

    def _values_of(self, name: str) -> dict[str, dict[LabelSet, None]]:
        by_value = self._by_label.get(name)
        if by_value is None:
            by_value = self._by_label[name] = {}
            for label_set in self._by_key.values():
                if (value := label_set.labels.get(name)) is not None:
                    by_value.setdefault(value, {})[label_set] = None
        return by_value


def _add(counts: dict[int, int], row: int, sign: int) -> None:
    count = counts.get(row, 0) + sign
    if count:
        counts[row] = count
    else:
        counts.pop(row, None)
