"""Amounts of single nodes as plain integers: for a handful of rows they are quicker than columns."""

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from robotapp_scheduler.core.node_table import NodeTable

MOST_ROWS: Final = 1024


KINDS: Final = ("allocatable", "requested", "scored")
Amounts = tuple[int, int, int]
"""One resource of one node, of each kind."""


class Row:
    """Amounts of one node as plain integers, as they are now: for the row form of a rule."""

    __slots__ = ("_known", "_row", "_table", "allowed_pods", "pod_count", "version")

    def __init__(self, table: "NodeTable", row: int) -> None:
        self._table = table
        self._row = row
        self._known: dict[tuple[str, ...], tuple[Amounts, ...]] = {}
        self.version = table.versions[row]
        self.allowed_pods = table.allowed_pods.item(row)
        self.pod_count = table.pod_count.item(row)

    def of(self, resources: tuple[str, ...]) -> tuple[Amounts, ...]:
        """What the node offers of these, and has given away, in this order; zeros for a resource nobody has."""
        found = self._known.get(resources)
        if found is None:
            found = self._known[resources] = self._amounts(resources)
        return found

    @property
    def resources(self) -> list[str]:
        """Names of all resources any node or pod has named."""
        return self._table.resources.names

    def _amounts(self, names: tuple[str, ...]) -> tuple[Amounts, ...]:
        resources = self._table.resources
        there: list[int] = resources.ledger[:, self._row].tolist()
        columns: list[list[int]] = []
        for kind in KINDS:
            span = resources.span(kind, names)
            if span is not None:
                columns.append(there[span])
            else:
                places = [resources.place(kind, name) for name in names]
                columns.append([0 if place is None else there[place] for place in places])
        return tuple(zip(*columns, strict=True))


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
