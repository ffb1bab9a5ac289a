"""`Snapshot`: the nodes as a plugin gets them, in read-only columns over all rows, or over the few rows that changed."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.api.core_v1 import Taint
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.nodes.columns import BoolArray, CodeArray, FloatArray, IntArray, Vocabulary
from robotapp_scheduler.core.nodes.node_facts import NodeFact
from robotapp_scheduler.core.nodes.node_table import Row
from robotapp_scheduler.core.nodes.resource_arrays import Plain
from robotapp_scheduler.core.robotics.rtt import RttRow
from robotapp_scheduler.core.selectors.pod_counts import Census, Wanted
from robotapp_scheduler.core.selectors.pod_matcher import pods_of

NO_LEDGER: Final[IntArray] = np.zeros((0, 0), dtype=np.int64)
LoadField = Literal["cpu_percent", "memory_percent", "gpu_percent"]


class LabelColumn(NamedTuple):
    """Values of one label as codes (0 = absent); `vocabulary.values[code]` is the text."""

    codes: CodeArray
    vocabulary: Vocabulary
    version: int = 0
    """Grows when any node's code does change."""

    def equals(self, value: str) -> BoolArray:
        """Rows whose label has this value."""
        return np.equal(self.codes, self.vocabulary.codes.get(value, -1))

    @property
    def exists(self) -> BoolArray:
        """Rows that have the label."""
        return np.not_equal(self.codes, 0)

    def texts(self) -> list[str]:
        """Value per row, "" where absent."""
        values = self.vocabulary.values
        return [values[code] for code in self.codes]


class Snapshot:
    """A read-only view of the node columns. All arrays have `n` elements in the same order as `names`.

    Rows without a node (holes) have name "" and zeros everywhere; results for them are ignored.
    """

    _as_counted: ClassVar = frozenset({"allocatable", "requested", "scored"})
    """Amounts that are those of the ledger."""
    # What most views never have costs them nothing: one is made for every decision.
    full = False
    """All rows are in view."""
    row_list: Sequence[int] = ()
    """The rows in view as plain integers, when they are not all."""
    _rows: npt.NDArray[np.intp] | slice | None = None
    _each: list[Row] | None = None
    _amount_codes: tuple[int, npt.NDArray[np.intp]] | Literal[False] | None = False
    _ledger: IntArray | None = None
    """The ledger that `_copied` was taken from: it may be laid out anew."""
    _copied: IntArray = NO_LEDGER

    def __init__(self, cluster: Cache, rows: Sequence[int] | npt.NDArray[np.intp] | None = None) -> None:
        self.cluster = cluster
        self._table = cluster.nodes
        self._kept: dict[tuple[str, Hashable], IntArray] = {}
        """Amounts that a plugin has read: several plugins read the same few columns."""
        if rows is None:
            self.full = True
            self._rows = slice(0, self._table.size)
            self.n = self._table.size
        else:
            self.row_list = rows if isinstance(rows, list) else [int(row) for row in rows]
            self.n = len(rows)

    def __repr__(self) -> str:
        return f"Snapshot({self.n} rows of {self._table.count} nodes)"

    @property
    def rows(self) -> npt.NDArray[np.intp] | slice:
        """The rows in view, as an index of columns."""
        if self._rows is None:
            self._rows = np.array(self.row_list, dtype=np.intp)
        return self._rows

    @cached_property
    def names(self) -> list[str]:
        """Node names, "" for holes."""
        if isinstance(self.rows, slice):
            return self._table.names
        return [self._table.names[row] for row in self.rows]

    @property
    def valid(self) -> BoolArray:
        """Rows that are nodes."""
        return self._pick(self._table.valid)

    @property
    def no_holes(self) -> bool:
        """Are all rows in view surely nodes?"""
        return self._table.count == self._table.size

    def indices(self, names: Collection[str]) -> list[int]:
        """Positions in this view of nodes by name; names that are not in view are left out."""
        rows = [self._table.row_of.get(name) for name in names]
        if isinstance(self.rows, slice):
            return [row for row in rows if row is not None]
        position = {int(row): i for i, row in enumerate(self.rows)}
        return [position[row] for row in rows if row is not None and row in position]

    def named(self, names: Collection[str]) -> BoolArray:
        """Rows of these nodes."""
        if isinstance(self.rows, slice):
            mask = np.zeros(self.n, dtype=np.bool_)
            mask[[row for name in names if (row := self._table.row_of.get(name)) is not None]] = True
            return mask
        return np.array([name in names for name in self.names], dtype=np.bool_)

    def labels_of(self, i: int) -> dict[str, str]:
        """All labels of the node at position i."""
        row = i if isinstance(self.rows, slice) else int(self.rows[i])
        return self._table.labels.of(row)

    def label(self, key: str) -> LabelColumn:
        """One label as codes."""
        codes, vocabulary = self._table.labels.column(key)
        return LabelColumn(self._pick(codes), vocabulary, self._table.labels.version(key))

    def allocatable(self, resource: str) -> IntArray:
        """What nodes offer: cpu in milli, everything else in whole units; zeros for a resource that no node has."""
        return self._amounts_of("allocatable", resource)

    def requested(self, resource: str) -> IntArray:
        """What the pods on each node request."""
        return self._amounts_of("requested", resource)

    def free(self, resource: str) -> IntArray:
        """Allocatable - requested; may be negative."""
        return self.allocatable(resource) - self.requested(resource)

    def scored(self, resource: str) -> IntArray:
        """As `requested`, but containers that name no cpu or memory count with a default (the Fit scorer's view)."""
        return self._amounts_of("scored", resource)

    @property
    def unschedulable(self) -> BoolArray:
        """spec.unschedulable."""
        return self._pick(self._table.unschedulable)

    @property
    def taint_sets(self) -> tuple[CodeArray, Sequence[tuple[Taint, ...]]]:
        """Code per row into the distinct taint lists: evaluate each list once, then index."""
        return self._pick(self._table.taints.column), self._table.taints.values

    def has_taint(self, key: str, value: str | None = None, effect: str | None = None) -> BoolArray:
        """Rows with such a taint."""
        codes, sets = self.taint_sets
        table = np.array(
            [
                any(
                    taint.key == key and value in {None, taint.value} and effect in {None, taint.effect}
                    for taint in taints
                )
                for taints in sets
            ],
            dtype=np.bool_,
        )
        return table[codes]

    @property
    def feature_sets(self) -> tuple[CodeArray, Sequence[frozenset[str]]]:
        """Code per row into the distinct sets of declared features."""
        return self._pick(self._table.features.column), self._table.features.values

    def count_pods(self, selector: Mapping[str, Any], namespace: str) -> IntArray:
        """Running pods of a namespace that match a label selector (plain JSON), per node; terminating ones left out."""
        counter = self.cluster.topology.counter(Wanted((pods_of(namespace, selector),), Census.ALIVE))
        return self._pick(counter.column[: self._table.size])

    def rtt_from(self, node: str, percentile: int = 95) -> RttRow:
        """RTT from a node to every row in microseconds (NaN unknown), and how each is known."""
        row = self.cluster.rtt.from_node(node, percentile)
        return RttRow(self._pick(row.rtt_us), self._pick(row.source))

    def fact(self, fact: NodeFact) -> npt.NDArray[Any]:
        """A fact that the plugin defines itself, in the type of its values."""
        return self._pick(self._table.facts.column(fact, self._table.objects))

    def load(self, field: LoadField) -> FloatArray:
        """Load as reported by the agents, NaN where unknown."""
        found = (self.cluster.rtt.load(name) for name in self.names)
        values = [getattr(load, field) if load is not None else None for load in found]
        return np.array([np.nan if value is None else value for value in values])

    def block(self, kind: str, resources: tuple[str, ...]) -> IntArray:
        """Shape (resources, n) of "allocatable", "requested", "free" or "scored" amounts: to reckon with all at once."""
        found = self._kept.get((kind, resources))
        if found is None:
            found = self._kept[kind, resources] = self._block(kind, resources)
        return found

    def surely_free(self, wanted: tuple[tuple[str, int], ...]) -> bool:
        """True when every node has these amounts free ("pods": places for pods); False: the rows decide."""
        return self.cluster.minimum_free.suffices(self.cluster.log, wanted)

    def plain(self, resources: tuple[str, ...]) -> Plain | None:
        """These amounts in float64, when all rows are in view and that makes no difference; else None."""
        if not self.full or not self.cluster.resource_arrays.refresh(self.cluster.log):
            return None
        return self.cluster.resource_arrays.plain(resources)

    @property
    def amount_codes(self) -> tuple[int, npt.NDArray[np.intp]] | None:
        """Generation and codes, None when they are of no use: see core.nodes.resource_arrays.AmountCodes."""
        if self._amount_codes is False:
            self._amount_codes = self.cluster.amount_codes.of(self.cluster.log, self.rows)
        return self._amount_codes

    def _block(self, kind: str, resources: tuple[str, ...]) -> IntArray:
        if kind in self._as_counted:
            span = self._table.resources.span(kind, resources)
            if span is not None:
                return self._counted(span)
        if kind == "free":
            resource_arrays = self.cluster.resource_arrays
            if (
                self.full
                and resource_arrays.refresh(self.cluster.log)
                and (free := resource_arrays.free(resources)) is not None
            ):
                found: IntArray = free.view()
            else:
                found = self._block("allocatable", resources) - self._block("requested", resources)
        else:
            found = np.empty((len(resources), self.n), dtype=np.int64)
            for i, resource in enumerate(resources):
                found[i] = getattr(self, kind)(resource)
        found.setflags(write=False)
        return found

    def _counted(self, place: int | slice) -> IntArray:
        """The rows in view of some columns of the ledger. Of a few rows the whole ledger is copied, once."""
        ledger = self._table.resources.ledger
        if self._ledger is not ledger:
            rows = self.rows
            self._ledger = ledger
            self._copied = ledger[:, rows] if isinstance(rows, slice) else ledger.take(rows, axis=1)
            self._copied.setflags(write=False)
        return self._copied[place]

    @property
    def each(self) -> list[Row]:
        """The rows in view, when they are not all, one by one."""
        if self._each is None:
            self._each = [*map(self._table.rows.get, self.row_list)]
        return self._each

    def _amounts_of(self, kind: str, resource: str) -> IntArray:
        found = self._kept.get((kind, resource))
        if found is None:
            place = self._table.resources.place(kind, resource)
            found = np.zeros(self.n, dtype=np.int64) if place is None else self._counted(place)
            self._kept[kind, resource] = found
        return found

    def pick(self, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The rows in view of a column over all table rows."""
        return self._pick(column[: self._table.size])

    def _pick(self, column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        picked = column[self.rows]
        picked.setflags(write=False)
        return picked


class AdjustedSnapshot(Snapshot):
    """The nodes as they would be if pods held more (or less) there: only requested amounts differ.

    `amounts` has the shape of core.cache.placed_pods.PriorityColumns: (1 + resources, rows in view), the number of pods first.
    """

    _as_counted = frozenset({"allocatable"})

    def __init__(self, cluster: Cache, rows: Sequence[int] | npt.NDArray[np.intp], amounts: IntArray) -> None:
        super().__init__(cluster, rows)
        self._amounts = amounts

    def requested(self, resource: str) -> IntArray:
        """What the pods of each node would request."""
        held = super().requested(resource)
        index = 0 if resource == "pods" else self._table.resources.index.get(resource, -1) + 1
        if index or resource == "pods":
            held = held + self._amounts[index]
        return held

    def surely_free(self, wanted: tuple[tuple[str, int], ...]) -> bool:  # noqa: ARG002 - of nodes that are so
        """Look at the rows."""
        return False

    def scored(self, resource: str) -> IntArray:
        """Not known for such nodes. Raises NotImplementedError: a filter must not decide by it."""
        raise NotImplementedError(f"scored {resource} of nodes that are not so")
