"""Growable node columns: one array element per node row, and string columns as integer codes.

Rows are stable while a node lives and are handed out again after it is gone, so every array has holes; `valid` says
which rows are nodes. Arrays grow by doubling, so a view taken earlier must not be kept across an added node.
"""

from collections.abc import Callable, Iterable
from typing import Any, Final, Generic, TypeVar

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
CodeArray = npt.NDArray[np.int32]
FloatArray = npt.NDArray[np.float64]

T = TypeVar("T")
PodAmounts = tuple[tuple[int, int], ...]
"""(index of a resource, amount) pairs."""

START_ROWS: Final = 64
BASE_RESOURCES: Final = ("cpu", "memory", "ephemeral-storage")
LARGEST: Final = 2**53
"""Amounts are cut here: sums and products with 100 stay inside int64, and no real node offers more."""
MOST_RESOURCES: Final = 1024
"""Different resources in a cluster: resources beyond that are not counted."""
MOST_STRANGE: Final = 256
"""Resources that pods may bring in without any node offering them."""
MOST_SPANS: Final = 256
MOST_STEPS: Final = 256
SCORED_CPU: Final = 0
SCORED_MEMORY: Final = 1
SCORED: Final = {"cpu": SCORED_CPU, "memory": SCORED_MEMORY}
"""Rows of `ResourceColumns.scored`; other resources are scored by what is requested."""
ALLOWED: Final = len(SCORED)
"""The ledger: what is scored; pods a node may have, and what it offers of every resource; pods it has, and what they request."""


def sane(amount: int) -> int:
    """An amount as it is counted: neither negative nor more than any node offers."""
    return max(0, min(amount, LARGEST))


def grown(array: npt.NDArray[np.generic], rows: int) -> npt.NDArray[np.generic]:
    """A copy whose last axis has `rows` elements; the new ones are zero."""
    result = np.zeros((*array.shape[:-1], rows), dtype=array.dtype)
    result[..., : array.shape[-1]] = array
    return result


class Vocabulary:
    """Strings (or any hashable values) as small codes; 0 is kept for "absent"."""

    __slots__ = ("codes", "values")

    def __init__(self) -> None:
        self.codes: dict[str, int] = {}
        self.values: list[str] = [""]

    def __repr__(self) -> str:
        return f"Vocabulary({len(self.codes)} values)"

    def code(self, value: str) -> int:
        """The code of a value, given out at first sight."""
        code = self.codes.get(value)
        if code is None:
            code = len(self.values)
            self.codes[value] = code
            self.values.append(value)
        return code

    def table(self, test: Callable[[str | None], bool]) -> BoolArray:
        """`test` per code: index it with a code column and the whole column is tested. Code 0 is tested as None."""
        result = np.empty(len(self.values), dtype=np.bool_)
        result[0] = test(None)
        for code in range(1, len(self.values)):
            result[code] = test(self.values[code])
        return result


class LabelColumns:
    """One code column per label key, made when a rule first reads the key and kept up to date from then on."""

    __slots__ = ("_columns", "_labels", "_rows", "_versions")

    def __init__(self) -> None:
        self._rows = START_ROWS
        self._labels: list[dict[str, str]] = []
        self._columns: dict[str, tuple[CodeArray, Vocabulary]] = {}
        self._versions: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"LabelColumns(keys={sorted(self._columns)})"

    def grow(self, rows: int) -> None:
        """Make room for `rows` rows."""
        self._rows = rows
        for key, (codes, vocabulary) in self._columns.items():
            self._columns[key] = (grown(codes, rows).astype(np.int32, copy=False), vocabulary)
            self._versions[key] += 1

    def version(self, key: str) -> int:
        """Grows when a row's code of this key changes or the column is replaced; 0 before the key was first read."""
        return self._versions.get(key, 0)

    def set(self, row: int, labels: dict[str, str]) -> None:
        """Replace all labels of a row; {} for a node that is gone."""
        while len(self._labels) <= row:
            self._labels.append({})
        self._labels[row] = labels
        for key, (codes, vocabulary) in self._columns.items():
            value = labels.get(key)
            code = 0 if value is None else vocabulary.code(value)
            if codes[row] != code:
                codes[row] = code
                self._versions[key] += 1

    def of(self, row: int) -> dict[str, str]:
        """Labels of one row."""
        return self._labels[row]

    def column(self, key: str) -> tuple[CodeArray, Vocabulary]:
        """Codes per row (0 = label absent) and their vocabulary."""
        found = self._columns.get(key)
        if found is None:
            found = self._build(key)
        return found

    def _build(self, key: str) -> tuple[CodeArray, Vocabulary]:
        vocabulary = Vocabulary()
        codes = np.zeros(self._rows, dtype=np.int32)
        for row, labels in enumerate(self._labels):
            value = labels.get(key)
            if value is not None:
                codes[row] = vocabulary.code(value)
        self._columns[key] = (codes, vocabulary)
        self._versions[key] = 1
        return codes, vocabulary


class Interned(Generic[T]):
    """Distinct values (taint sets, for instance) as codes, with a code column per row."""

    __slots__ = ("_codes", "column", "values")

    def __init__(self, first: T) -> None:
        self.values: list[T] = [first]
        self._codes: dict[T, int] = {first: 0}
        self.column: CodeArray = np.zeros(START_ROWS, dtype=np.int32)

    def __repr__(self) -> str:
        return f"Interned({len(self.values)} distinct)"

    def grow(self, rows: int) -> None:
        """Make room for `rows` rows."""
        self.column = grown(self.column, rows).astype(np.int32, copy=False)

    def set(self, row: int, value: T) -> None:
        """Store the value of a row."""
        code = self._codes.get(value)
        if code is None:
            code = len(self.values)
            self._codes[value] = code
            self.values.append(value)
        self.column[row] = code


class ResourceColumns:
    """int64 amounts per (resource, row): cpu in milli, everything else in whole units.

    All stand in one array, the ledger, so that what there is about a few rows can be copied out in one piece.
    """

    __slots__ = (
        "_places", "_spans", "_steps", "_strange", "allocatable", "allowed_pods", "held_from", "index", "layout", "ledger",
        "names", "offered", "pod_count", "requested", "scored", "taken",
    )  # fmt: skip

    def __init__(self) -> None:
        self.names: list[str] = list(BASE_RESOURCES)
        self.index: dict[str, int] = {name: i for i, name in enumerate(self.names)}
        self._spans: dict[tuple[str, tuple[str, ...]], slice] = {}
        """Where amounts that are read together stand: until the ledger is laid out anew, a resource keeps its place."""
        self._steps: dict[tuple[PodAmounts, tuple[int, int]], IntArray] = {}
        """What pods add to a row of nodes that have them: most pods are one of many replicas."""
        self._places: dict[tuple[str, ...], tuple[tuple[int, int, int], ...]] = {}
        self.layout = 0
        """Grows when the ledger is laid out anew."""
        self._strange = 0
        self._lay_out(np.zeros((ALLOWED + 2 + 2 * len(self.names), START_ROWS), dtype=np.int64))

    def __repr__(self) -> str:
        return f"ResourceColumns({self.names})"

    def _lay_out(self, ledger: IntArray) -> None:
        held = self.held_from = (ALLOWED + len(ledger)) // 2
        """Where what pods hold begins, their number first."""
        self.layout += 1
        self.ledger: IntArray = ledger
        self.scored: IntArray = ledger[:ALLOWED]
        """cpu milli and memory bytes with defaults for containers that request nothing (the Fit scorer's view)."""
        self.offered: IntArray = ledger[ALLOWED:held]
        """Pods a node may have, then what it offers of every resource."""
        self.taken: IntArray = ledger[held:]
        """Pods it has, then what they request: in the order of `offered`."""
        self.allowed_pods: IntArray = ledger[ALLOWED]
        self.allocatable: IntArray = ledger[ALLOWED + 1 : held]
        self.pod_count: IntArray = ledger[held]
        self.requested: IntArray = ledger[held + 1 :]
        self._spans.clear()
        self._steps.clear()
        self._places.clear()

    def grow(self, rows: int) -> None:
        """Make room for `rows` rows."""
        self._lay_out(grown(self.ledger, rows).astype(np.int64, copy=False))

    def place(self, kind: str, resource: str) -> int | None:
        """Where in the ledger is what nodes have ("allocatable") or what their pods request ("requested", "scored")? None =
        no node has any.
        """
        if kind == "scored" and resource in SCORED:
            return SCORED[resource]
        code = -1 if resource == "pods" else self.index.get(resource)
        if code is None:
            return None
        return (ALLOWED if kind == "allocatable" else self.held_from) + 1 + code

    def span(self, kind: str, resources: tuple[str, ...]) -> slice | None:
        """The places of all these, if they stand side by side in this order."""
        found = self._spans.get((kind, resources))
        if found is None:
            places = [self.place(kind, resource) for resource in resources]
            first = places[0] if places else None
            if first is None or places != [*range(first, first + len(places))]:
                return None
            if len(self._spans) >= MOST_SPANS:
                self._spans.clear()
            found = self._spans[kind, resources] = slice(first, first + len(places))
        return found

    def places(self, resources: tuple[str, ...]) -> tuple[tuple[int, int, int], ...]:
        """Where in a `copied` row each of these is allocatable, requested and scored."""
        found = self._places.get(resources)
        if found is None:
            if len(self._places) >= MOST_SPANS:
                self._places.clear()
            found = self._places[resources] = tuple(
                [
                    (self._at("allocatable", name), self._at("requested", name), self._at("scored", name))
                    for name in resources
                ]
            )
        return found

    def _at(self, kind: str, resource: str) -> int:
        place = self.place(kind, resource)
        return -1 if place is None else place

    def copied(self, row: int) -> list[int]:
        """One row of the ledger, and a zero for what no node has."""
        found: list[int] = self.ledger[:, row].tolist()
        found.append(0)
        return found

    def code(self, name: str) -> int:
        """Index of a resource, added at first sight."""
        found = self.index.get(name)
        if found is None:
            found = len(self.names)
            self.names.append(name)
            self.index[name] = found
            self._places.clear()
            if found >= len(self.allocatable):
                empty = np.zeros_like(self.allocatable)
                self._lay_out(
                    np.concatenate([self.ledger[: self.held_from], empty, self.ledger[self.held_from :], empty])
                )
        return found

    def coded(self, amounts: dict[str, int]) -> tuple[tuple[int, int], ...]:
        """(index, amount) pairs of a resource list. Zero amounts are left out, and so are negative ones, which would add room
        to a node.
        """
        left = MOST_RESOURCES - len(self.names)
        if len(amounts) > left:
            strange = [name for name in amounts if name not in self.index]
            left_out = set(strange[left:])
            amounts = {name: value for name, value in amounts.items() if name not in left_out}
        return tuple((self.code(name), min(value, LARGEST)) for name, value in amounts.items() if value > 0)

    def held(self, amounts: dict[str, int]) -> tuple[tuple[int, int], ...]:
        """The same for what a pod holds. Any user may run a pod that requests ten thousand resources no node offers: only
        so many of them become columns, the others count nowhere.
        """
        strange = [name for name in amounts if name not in self.index]
        if strange:
            room = max(0, MOST_STRANGE - self._strange)
            self._strange += min(room, len(strange))
            left_out = set(strange[room:])
            amounts = {name: value for name, value in amounts.items() if name not in left_out}
        return self.coded(amounts)

    def set_allocatable(self, row: int, amounts: Iterable[tuple[int, int]]) -> None:
        """Replace what a row offers."""
        self.allocatable[:, row] = 0
        for code, value in amounts:
            self.allocatable[code, row] = value

    def count(self, row: int, requested: PodAmounts, scored: tuple[int, int], sign: int) -> None:
        """Count a pod in (+1) or out (-1). `scored` are its cpu milli and memory bytes in the Fit scorer's view."""
        step = self._steps.get((requested, scored))
        if step is None:
            step = self._step(requested, scored)
        there = self.ledger[:, row]
        if sign > 0:
            there += step
        else:
            there -= step

    def _step(self, requested: PodAmounts, scored: tuple[int, int]) -> IntArray:
        """What such a pod adds to each row of the ledger."""
        step: IntArray = np.zeros(len(self.ledger), dtype=np.int64)
        step[SCORED_CPU], step[SCORED_MEMORY] = scored
        step[self.held_from] = 1
        for code, value in requested:
            step[self.held_from + 1 + code] = value
        if len(self._steps) >= MOST_STEPS:
            self._steps.clear()
        self._steps[requested, scored] = step
        return step


def order_of(codes: npt.NDArray[np.integer[Any]], count: int) -> npt.NDArray[np.intp]:
    """The stable order of codes from 0 to below `count`. Up to 65,536 of them numpy sorts by digits, ten times as fast."""
    return np.argsort(codes.astype(np.min_scalar_type(max(count - 1, 0))), kind="stable")
