"""Counts per topology domain: one number per value of a node label, kept up to date pod by pod."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final

import numpy as np

from robotapp_scheduler.core.nodes.columns import BoolArray, CodeArray, IntArray, LabelColumns

MOST_SCOPES: Final = 128
NO_ROWS: Final[BoolArray] = np.zeros(0, dtype=np.bool_)


class Scope:
    """The rows whose pods count; compared by identity. `set` renews it after nodes changed."""

    __slots__ = ("mask", "version")

    def __init__(self) -> None:
        self.mask: BoolArray = NO_ROWS
        self.version = 0

    def __repr__(self) -> str:
        return f"Scope({int(self.mask.sum())} of {len(self.mask)} rows)"

    def set(self, mask: BoolArray) -> None:
        """These rows count from now on."""
        if not np.array_equal(mask, self.mask):
            self.mask = mask
            self.version += 1


class Scopes:
    """Scopes by what they depend on, made anew when the nodes change; the least recently used ones are dropped."""

    __slots__ = ("_scopes",)

    def __init__(self) -> None:
        self._scopes: OrderedDict[Hashable, tuple[Scope, Hashable]] = OrderedDict()

    def __repr__(self) -> str:
        return f"Scopes({len(self._scopes)})"

    def get(self, key: Hashable, version_key: Hashable, mask: Callable[[], BoolArray]) -> Scope:
        """The scope of this key; `mask` is called when `version_key` differs from that of the last call."""
        found = self._scopes.get(key)
        scope = found[0] if found is not None else Scope()
        if found is None or found[1] != version_key:
            scope.set(mask())
            self._scopes[key] = (scope, version_key)
            if len(self._scopes) > MOST_SCOPES:
                self._scopes.popitem(last=False)
        self._scopes.move_to_end(key)
        return scope


class Domains:
    """A column of counts added up per value of one node label; code 0 holds the rows without the label.

    `add` keeps it true while pods come and go; `renew` adds it up again after nodes changed the label or the scope.
    """

    __slots__ = ("_at", "_codes", "_labels", "key", "present", "scope", "values")

    def __init__(self, labels: LabelColumns, key: str, scope: Scope | None = None) -> None:
        self._labels = labels
        self._at = (-1, -1)
        self._codes: CodeArray = np.zeros(0, dtype=np.int32)
        self.key = key
        self.scope = scope
        self.values: IntArray = np.zeros(1, dtype=np.int64)
        """Count per code of the label."""
        self.present: IntArray = np.zeros(0, dtype=np.int64)
        """Codes of the domains with a row in scope (only kept with a scope)."""

    def __repr__(self) -> str:
        return f"Domains({self.key}, {len(self.values) - 1} domains)"

    @property
    def stale(self) -> bool:
        """Did nodes change since it was added up?"""
        return self._at != (self._labels.version(self.key), self.scope.version if self.scope is not None else 0)

    def add(self, row: int, amount: int) -> None:
        """Pods on one row came (positive) or went."""
        if self._at[0] != self._labels.version(self.key):
            return  # added up again before it is read
        scope = self.scope
        if scope is None or (row < len(scope.mask) and scope.mask[row]):
            self.values[self._codes[row]] += amount

    def renew(self, column: IntArray) -> None:
        """Add up a column of counts per row."""
        codes, vocabulary = self._labels.column(self.key)
        width = len(vocabulary.values)
        scope = self.scope
        if scope is None:
            self.values = _counts_per_domain(codes, column[: len(codes)], width)
        else:
            rows = len(scope.mask)
            self.values = _counts_per_domain(codes[:rows], np.where(scope.mask, column[:rows], 0), width)
            there = np.bincount(codes[:rows][scope.mask], minlength=width)
            there[0] = 0
            self.present = np.flatnonzero(there)
        self._codes = codes
        self._at = (self._labels.version(self.key), scope.version if scope is not None else 0)


def _counts_per_domain(codes: CodeArray, counts: IntArray, width: int) -> IntArray:
    if len(counts) < len(codes):
        codes = codes[: len(counts)]
    return np.bincount(codes, weights=counts, minlength=width).astype(np.int64)
