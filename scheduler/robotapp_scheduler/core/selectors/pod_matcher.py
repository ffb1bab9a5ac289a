"""Compiled pod selectors: hashable, and indexed by one of the labels that they require."""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Any, Generic, NamedTuple, TypeVar

from robotapp_api.values.selector import Expression, label_requirements, matches_requirements

T = TypeVar("T", bound=Hashable)
Requirements = tuple[Expression, ...]


class PodMatcher(NamedTuple):
    """Pods of these namespaces (None = all) that meet these expressions (None = no pod at all)."""

    namespaces: frozenset[str] | None
    requirements: Requirements | None

    def matches(self, namespace: str, labels: Mapping[str, str]) -> bool:
        """Whether a pod of this namespace with these labels matches."""
        if self.requirements is None or (self.namespaces is not None and namespace not in self.namespaces):
            return False
        return matches_requirements(self.requirements, labels)


def pods_of(namespace: str, selector: Mapping[str, Any] | None) -> PodMatcher:
    """Pods of one namespace that match a label selector (plain JSON)."""
    return PodMatcher(frozenset((namespace,)), label_requirements(selector))


def handle(requirements: Requirements) -> tuple[str, tuple[str, ...]] | None:
    """A label key and the values one of which a matching pod must have; None when no expression requires one."""
    return next((each[::2] for each in requirements if each.operator == "In"), None)


class ByLabel(Generic[T]):
    """An inverted index of things with requirements: for the labels of a pod it yields only those that may match."""

    __slots__ = ("_loose", "_pairs")

    def __init__(self) -> None:
        self._pairs: dict[tuple[str, str], dict[T, None]] = {}
        self._loose: dict[T, None] = {}

    def __repr__(self) -> str:
        return f"ByLabel({len(self._pairs)} pairs, {len(self._loose)} without)"

    def add(self, thing: T, requirements: Requirements) -> None:
        """Keep a thing under one of its requirements."""
        for bucket in self._buckets(requirements):
            bucket[thing] = None

    def remove(self, thing: T, requirements: Requirements) -> None:
        """Forget a thing."""
        found = handle(requirements)
        if found is None:
            self._loose.pop(thing, None)
            return
        for value in found[1]:
            bucket = self._pairs.get((found[0], value), {})
            bucket.pop(thing, None)
            if not bucket:
                self._pairs.pop((found[0], value), None)

    def candidates(self, labels: Mapping[str, str]) -> Iterator[T]:
        """Everything that may match these labels, each once."""
        yield from self._loose
        if self._pairs:
            for pair in labels.items():
                yield from self._pairs.get(pair, ())

    def _buckets(self, requirements: Requirements) -> Iterable[dict[T, None]]:
        found = handle(requirements)
        if found is None:
            return (self._loose,)
        return [self._pairs.setdefault((found[0], value), {}) for value in found[1]]
