"""Finds the affinity terms of placed pods that match a pod to be placed, and their effect.

Pods are counted per *distinct* term. A pod to be placed meets them through the `Pull` on its labels: the terms that
concern it, found once, and their counts per topology domain, kept true while pods come and go.
"""

from collections import OrderedDict
from collections.abc import Iterable
from typing import Final

import numpy as np

from robotapp_scheduler.core.nodes.columns import CodeArray, IntArray, LabelColumns
from robotapp_scheduler.core.selectors.affinity_terms import Kind, Namespaces, Term, Terms
from robotapp_scheduler.core.selectors.label_sets import LabelSetKey
from robotapp_scheduler.core.selectors.pod_matcher import ByLabel

MOST_PULLS: Final = 512


class PlacedTerm:
    """One distinct term: how many pods on which rows have it."""

    __slots__ = ("listeners", "rows", "term", "users")

    def __init__(self, term: Term) -> None:
        self.term = term
        self.users = 0
        self.rows: dict[int, int] = {}
        self.listeners: dict[TermTotals, None] = {}

    def __repr__(self) -> str:
        return f"PlacedTerm({self.term}, {self.users} pods)"

    def count(self, row: int, sign: int) -> None:
        """A pod with this term came (+1) or went (-1)."""
        count = self.rows.get(row, 0) + sign
        if count:
            self.rows[row] = count
        else:
            del self.rows[row]
        for totals in self.listeners:
            totals.add(row, sign * self.term.weight)


class TermTotals:
    """Weighted counts of some terms with one topology key, per value of that node label (code 0: label absent)."""

    __slots__ = ("_codes", "_labels", "_terms", "_values", "_version", "key", "users")

    def __init__(self, labels: LabelColumns, key: str, terms: tuple[PlacedTerm, ...]) -> None:
        self.key = key
        self.users = 0
        """Pulls that use it."""
        self._labels = labels
        self._terms = terms
        self._version = -1
        self._codes: CodeArray = np.zeros(0, dtype=np.int32)
        self._values: IntArray = np.zeros(1, dtype=np.int64)
        for placed in terms:
            placed.listeners[self] = None

    def __repr__(self) -> str:
        return f"TermTotals({self.key}, {len(self._terms)} terms)"

    def add(self, row: int, amount: int) -> None:
        """Weight on one row came or went."""
        if self._version == self._labels.version(self.key):
            self._values[self._codes[row]] += amount

    @property
    def values(self) -> IntArray:
        """Weighted count per code of the label; code 0 (label absent) is always 0."""
        if self._version != self._labels.version(self.key):
            self._renew()
        self._values[0] = 0
        return self._values

    @property
    def terms(self) -> tuple[PlacedTerm, ...]:
        """What it adds up."""
        return self._terms

    def close(self) -> None:
        """No pull uses it any more."""
        for placed in self._terms:
            placed.listeners.pop(self, None)

    def _renew(self) -> None:
        codes, vocabulary = self._labels.column(self.key)
        self._codes = codes
        self._values = np.zeros(len(vocabulary.values), dtype=np.int64)
        for placed in self._terms:
            count = len(placed.rows)
            rows = np.fromiter(placed.rows.keys(), dtype=np.intp, count=count)
            pods = np.fromiter(placed.rows.values(), dtype=np.int64, count=count)
            np.add.at(self._values, codes[rows], placed.term.weight * pods)
        self._version = self._labels.version(self.key)


class Pull:
    """All terms of placed pods that concern pods of one namespace with the same labels, by kind."""

    __slots__ = ("by_kind", "generation", "seen")

    def __init__(self, by_kind: dict[Kind, tuple[TermTotals, ...]], seen: int, generation: int) -> None:
        self.by_kind = by_kind
        self.seen = seen
        self.generation = generation

    def __repr__(self) -> str:
        return f"Pull({self.by_kind})"

    def __getitem__(self, kind: Kind) -> tuple[TermTotals, ...]:
        return self.by_kind.get(kind, ())


class AffinityIndex:
    """Distinct terms of placed pods and the pulls that follow them."""

    def __init__(self, labels: LabelColumns, namespaces: Namespaces) -> None:
        self._labels = labels
        self._namespaces = namespaces
        self._terms: dict[Term, PlacedTerm] = {}
        self._by_label: ByLabel[PlacedTerm] = ByLabel()
        self._recent: list[Term] = []
        """Terms in the order they were first seen since `_before`."""
        self._before = 0
        self._pulls: OrderedDict[LabelSetKey, Pull] = OrderedDict()
        self._totals: dict[tuple[PlacedTerm, ...], TermTotals] = {}
        """By their terms (all of one kind and topology key): pods whose other labels differ share them."""

    def __repr__(self) -> str:
        return f"AffinityIndex({len(self._terms)} terms, {len(self._pulls)} pulls)"

    def __len__(self) -> int:
        return len(self._terms)

    def take(self, terms: Terms) -> tuple[PlacedTerm, ...]:
        """The distinct terms of a pod that was placed; each stays until it is released as often."""
        found = []
        for term in (*terms.affinity, *terms.anti_affinity, *terms.preferred):
            placed = self._terms.get(term)
            if placed is None:
                placed = self._terms[term] = PlacedTerm(term)
                self._by_label.add(placed, term.requirements or ())
                self._note(term)
            placed.users += 1
            found.append(placed)
        return tuple(found)

    def release(self, terms: Iterable[PlacedTerm]) -> None:
        """A pod with these terms is no longer placed."""
        for placed in terms:
            placed.users -= 1
            if not placed.users:
                del self._terms[placed.term]
                self._by_label.remove(placed, placed.term.requirements or ())

    def pull(self, key: LabelSetKey) -> Pull:
        """The placed pods' terms that match a pod of this namespace with these labels, and their effect."""
        pull = self._pulls.get(key)
        if pull is not None and self._is_current(pull, key):
            self._pulls.move_to_end(key)
            return pull
        old, pull = pull, self._follow(key)
        self._pulls[key] = pull
        if old is not None:
            self._close(old)
        if len(self._pulls) > MOST_PULLS:
            self._close(self._pulls.popitem(last=False)[1])
        return pull

    def _is_current(self, pull: Pull, key: LabelSetKey) -> bool:
        newest = self._before + len(self._recent)
        if pull.generation != self._namespaces.generation or pull.seen < self._before:
            return False
        if pull.seen == newest:
            return True
        namespace, labels = key[0], dict(key[1])
        of_namespace = self._namespaces.labels_of(namespace)
        if any(term.concerns(namespace, labels, of_namespace) for term in self._recent[pull.seen - self._before :]):
            return False
        pull.seen = newest
        return True

    def _follow(self, key: LabelSetKey) -> Pull:
        namespace, labels = key[0], dict(key[1])
        of_namespace = self._namespaces.labels_of(namespace)
        found: dict[Kind, dict[str, list[PlacedTerm]]] = {}
        for placed in self._by_label.candidates(labels):
            term = placed.term
            if term.concerns(namespace, labels, of_namespace):
                found.setdefault(term.kind, {}).setdefault(term.topology_key, []).append(placed)
        by_kind = {
            kind: tuple(self._shared(key, tuple(terms)) for key, terms in by_key.items())
            for kind, by_key in found.items()
        }
        return Pull(by_kind, self._before + len(self._recent), self._namespaces.generation)

    def _shared(self, key: str, terms: tuple[PlacedTerm, ...]) -> TermTotals:
        totals = self._totals.get(terms)
        if totals is None:
            totals = self._totals[terms] = TermTotals(self._labels, key, terms)
        totals.users += 1
        return totals

    def _close(self, pull: Pull) -> None:
        for found in pull.by_kind.values():
            for totals in found:
                totals.users -= 1
                if not totals.users:
                    totals.close()
                    del self._totals[totals.terms]

    def _note(self, term: Term) -> None:
        self._recent.append(term)
        if len(self._recent) > MOST_PULLS:
            self._before += len(self._recent)
            self._recent.clear()
