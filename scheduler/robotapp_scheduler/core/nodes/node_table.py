"""Nodes as columns with stable rows, and the amounts of single nodes as plain integers, which are quicker for a few rows."""

from hashlib import blake2b
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from robotapp_api.model.names import Label
from robotapp_api.values.quantities.requests import amounts
from robotapp_claims.rules.instances import primary_node
from robotapp_scheduler.core.api.core_v1 import Node, Taint
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.nodes.columns import (
    ALLOWED,
    LARGEST,
    START_ROWS,
    BoolArray,
    IntArray,
    Interned,
    LabelColumns,
    ResourceColumns,
    grown,
)
from robotapp_scheduler.core.nodes.node_facts import FactColumns
from robotapp_scheduler.core.nodes.tenants import Tenants

MOST_ROWS: Final = 1024


NodeAmounts = tuple[int, int, int]
"""One resource of one node: what it offers, what its pods request, and that as the Fit scorer counts it."""


class Row:
    """Amounts of one node as plain integers, as they are now: for the row form of a rule."""

    __slots__ = ("_known", "_layout", "_row", "_table", "_there", "allowed_pods", "pod_count", "version")

    def __init__(self, table: "NodeTable", row: int) -> None:
        self._table = table
        self._row = row
        self._known: dict[tuple[str, ...], tuple[NodeAmounts, ...]] = {}
        self.version = table.versions[row]
        resources = table.resources
        self._there, self._layout = resources.copied(row), resources.layout
        self.allowed_pods, self.pod_count = self._there[ALLOWED], self._there[resources.held_from]

    def of(self, resources: tuple[str, ...]) -> tuple[NodeAmounts, ...]:
        """What the node offers of these, and has given away, in this order; zeros for a resource that no node has."""
        found = self._known.get(resources)
        if found is None:
            columns = self._table.resources
            if self._layout != columns.layout:
                self._there, self._layout = columns.copied(self._row), columns.layout
            there = self._there
            found = tuple([(there[a], there[b], there[c]) for a, b, c in columns.places(resources)])
            self._known[resources] = found
        return found

    @property
    def resources(self) -> list[str]:
        """Names of all resources any node or pod has named."""
        return self._table.resources.names


class Rows:
    """Rows that were looked at one by one, kept until something changes there: many kinds of pod read the same rows."""

    def __init__(self, table: "NodeTable") -> None:
        self._table = table
        self._rows: dict[int, Row] = {}

    def get(self, row: int) -> Row:
        """The row as it is now."""
        found = self._rows.get(row)
        if found is None or found.version != self._table.versions[row]:
            if len(self._rows) >= MOST_ROWS:
                self._rows.clear()
            found = self._rows[row] = Row(self._table, row)
        return found


ROBOT_TIER: Final = "robot"


class Computer(NamedTuple):
    """A node as the rule for robots of several computers reads it."""

    name: str
    labels: dict[str, str]


class NodeTable:
    """One row per node: what it offers, its labels and taints, and how much is taken.

    `size` rows are in use (holes included), `count` of them are nodes. A row's requested amounts are kept by the
    cluster, which counts pods in and out.
    """

    def __init__(self) -> None:
        self.size = 0
        self.count = 0
        self.names: list[str] = []
        self.row_of: dict[str, int] = {}
        self.resources = ResourceColumns()
        self.labels = LabelColumns()
        self.taints: Interned[tuple[Taint, ...]] = Interned(())
        self.features: Interned[frozenset[str]] = Interned(frozenset())
        """status.declaredFeatures."""
        self.valid: BoolArray = np.zeros(START_ROWS, dtype=np.bool_)
        self.unschedulable: BoolArray = np.zeros(START_ROWS, dtype=np.bool_)
        self.name_hash: npt.NDArray[np.uint64] = np.zeros(START_ROWS, dtype=np.uint64)
        self.annotations: list[dict[str, str]] = []
        self.objects: list[Node | None] = []
        """The objects of the watch's store, None for holes."""
        self.facts = FactColumns()
        self.robots: dict[str, dict[str, None]] = {}
        """Robot name → names of its nodes."""
        self.tenants = Tenants()
        self.generation = 0
        """Grows when a node comes, goes or changes labels."""
        self.taint_generation = 0
        """Grows when a node changes its taints."""
        self.zone_generation = 0
        """Grows when a node comes, goes or changes its zone."""
        self.versions: list[int] = []
        """Per row a number that grows when its node or one of its pods changes in any way."""
        self.rows = Rows(self)
        self._free: list[int] = []

    def __repr__(self) -> str:
        return f"NodeTable({self.count} nodes in {self.size} rows)"

    @property
    def allowed_pods(self) -> IntArray:
        """Pods that a node may have."""
        return self.resources.allowed_pods

    @property
    def pod_count(self) -> IntArray:
        """Pods that it has."""
        return self.resources.pod_count

    @property
    def scored(self) -> IntArray:
        """See `ResourceColumns.scored`."""
        return self.resources.scored

    def apply(self, node: Node) -> tuple[int, Change]:
        """Add or update a node; answers its row and what is different. Raises ValueError for unreadable amounts."""
        name = node.metadata.name
        offered = amounts(node.status.allocatable)
        row = self.row_of.get(name)
        change = Change.NONE
        if row is None:
            row, change = self._take_row(name), Change.NODE_ADDED
        change |= self._set_offered(row, offered)
        change |= self._set_labels(row, node.metadata.labels or {})
        change |= self._set_taints(row, node)
        change |= self._set_annotations(row, node.metadata.annotations or {})
        change |= self._set_features(row, frozenset(node.status.declared_features))
        if self.tenants.apply(name, self.labels.of(row), self.annotations[row]):
            change |= Change.TENANTS
        if self.facts.apply(row, node):
            change |= Change.FACTS
        self.objects[row] = node
        if change:
            self.versions[row] += 1
        if change & (Change.NODE_ADDED | Change.LABELS):
            self.generation += 1
        return row, change

    def remove(self, name: str) -> int | None:
        """Forget a node; answers the row that became free."""
        row = self.row_of.pop(name, None)
        if row is None:
            return None
        self._set_labels(row, {})
        self.valid[row] = False
        self.names[row] = ""
        self.annotations[row] = {}
        self.objects[row] = None
        self.facts.remove(row)
        self.taints.set(row, ())
        self.features.set(row, frozenset())
        self.unschedulable[row] = False
        self.resources.set_allocatable(row, ())
        self.resources.requested[:, row] = 0
        self.allowed_pods[row] = self.pod_count[row] = 0
        self.scored[:, row] = 0
        self.versions[row] += 1
        self.count -= 1
        self.generation += 1
        self.zone_generation += 1
        self._free.append(row)
        return row

    def amounts(self, kind: str, resource: str) -> IntArray | None:
        """The column of what nodes have ("allocatable") or what their pods request ("requested", "scored"); None = no node has any."""
        place = self.resources.place(kind, resource)
        return None if place is None else self.resources.ledger[place]

    def named(self, label: Label, value: str) -> tuple[str, ...]:
        """Names of the nodes with this label value, in row order."""
        codes, vocabulary = self.labels.column(str(label))
        code = vocabulary.codes.get(value)
        if code is None:
            return ()
        return tuple(self.names[row] for row in np.flatnonzero(codes[: self.size] == code))

    def robot_end(self, robot: str) -> tuple[str, ...]:
        """The robot's primary node, or all of its nodes while none or several are labelled so: then the nearest one counts.

        The operator starts nothing on such a robot, but the pods it started before must find their places again.
        """
        names = sorted(self.robots.get(robot, ()))
        if len(names) > 1:
            primary = primary_node(robot, [Computer(name, self.labels.of(self.row_of[name])) for name in names])
            if primary.node:
                return (primary.node,)
        return tuple(names)

    def robot_of(self, name: str) -> str:
        """The robot whose computer the node is; "" for any other node."""
        row = self.row_of.get(name)
        return self.labels.of(row).get(Label.ROBOT, "") if row is not None else ""

    def on_robot(self, name: str) -> bool | None:
        """Is the node of the robot tier? None for a node that is not here (any more)."""
        row = self.row_of.get(name)
        if row is None:
            return None
        labels = self.labels.of(row)
        return Label.ROBOT in labels or labels.get(Label.TIER) == ROBOT_TIER

    def _take_row(self, name: str) -> int:
        if self._free:
            row = self._free.pop()
        else:
            row = self.size
            self.size += 1
            self.names.append("")
            self.annotations.append({})
            self.objects.append(None)
            self.versions.append(0)
            if self.size > len(self.valid):
                self._grow(2 * len(self.valid))
        self.names[row] = name
        self.row_of[name] = row
        self.valid[row] = True
        self.name_hash[row] = int.from_bytes(blake2b(name.encode(), digest_size=8).digest(), "little")
        self.labels.set(row, {})
        self.zone_generation += 1
        self.count += 1
        return row

    def _grow(self, rows: int) -> None:
        for name in ("valid", "unschedulable", "name_hash"):
            setattr(self, name, grown(getattr(self, name), rows))
        self.resources.grow(rows)
        self.labels.grow(rows)
        self.taints.grow(rows)
        self.features.grow(rows)
        self.facts.grow(rows)

    def _set_offered(self, row: int, offered: dict[str, int]) -> Change:
        allowed = min(offered.pop("pods", 0), LARGEST)
        coded = self.resources.coded(offered)
        column = self.resources.allocatable[:, row]
        same = self.allowed_pods[row] == allowed and np.count_nonzero(column) == len(coded)
        if same and all(column[code] == value for code, value in coded):
            return Change.NONE
        self.resources.set_allocatable(row, coded)
        self.allowed_pods[row] = allowed
        return Change.ALLOCATABLE

    def _set_labels(self, row: int, labels: dict[str, str]) -> Change:
        old = self.labels.of(row)
        if old == labels:
            return Change.NONE
        if old.get(Label.ZONE) != labels.get(Label.ZONE):
            self.zone_generation += 1
        name = self.names[row]
        if (robot := old.get(Label.ROBOT)) and robot in self.robots:
            self.robots[robot].pop(name, None)
            if not self.robots[robot]:
                del self.robots[robot]
        if robot := labels.get(Label.ROBOT):
            self.robots.setdefault(robot, {})[name] = None
        self.labels.set(row, labels)
        return Change.LABELS

    def _set_taints(self, row: int, node: Node) -> Change:
        unschedulable = node.spec.unschedulable
        if self.taints.values[self.taints.column[row]] == node.spec.taints and self.unschedulable[row] == unschedulable:
            return Change.NONE
        self.taints.set(row, node.spec.taints)
        self.taint_generation += 1
        self.unschedulable[row] = unschedulable
        return Change.TAINTS

    def _set_features(self, row: int, features: frozenset[str]) -> Change:
        if self.features.values[self.features.column[row]] == features:
            return Change.NONE
        self.features.set(row, features)
        return Change.FEATURES

    def _set_annotations(self, row: int, annotations: dict[str, str]) -> Change:
        if self.annotations[row] == annotations:
            return Change.NONE
        self.annotations[row] = annotations
        return Change.ANNOTATIONS
