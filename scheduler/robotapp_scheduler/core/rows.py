"""Amounts of single nodes as plain integers: for a handful of rows they are quicker than columns."""

from typing import TYPE_CHECKING, Final

from robotapp_scheduler.core.columns import ALLOWED

if TYPE_CHECKING:
    from robotapp_scheduler.core.node_table import NodeTable

MOST_ROWS: Final = 1024


NodeAmounts = tuple[int, int, int]
"""One resource of one node: what it offers, what its pods ask for, and that as the Fit scorer sees it."""


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
        """What the node offers of these, and has given away, in this order; zeros for a resource nobody has."""
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
    """Rows that were looked at one by one, kept until something changes there: many kinds of pod ask for the same."""

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
