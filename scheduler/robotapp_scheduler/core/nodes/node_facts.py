"""NodeFact: a fact about nodes that one plugin defines, reads and is woken by, as a column beside those of the node table."""

import logging
from collections.abc import Callable, Sequence
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from robotapp_scheduler.core.api.core_v1 import Node
from robotapp_scheduler.core.events.cluster_event import READS
from robotapp_scheduler.core.nodes.columns import START_ROWS, grown

log = logging.getLogger(__name__)

KINDS: Final = (bool, int, float)
INT64_MAX: Final = 2**63 - 1


class NodeFact:
    """One value per node that follows from the Node object alone. `nodes.fact(NOISE)` is the column of it.

    Name the fact in `node_reads`, and results are computed again for nodes whose value changed; with Change.FACTS in `events`
    such a change calls the plugin's `hint`, where `NOISE.of(event.new)` is the value now.

    The column is made when it is read for the first time, kept up to date from then on, and dropped with the fact.
    """

    __slots__ = ("__weakref__", "absent", "derive", "name", "of", "warned")

    changes = READS["facts"]
    """Results for a row must be computed again after these."""

    def __init__(self, name: str, derive: Callable[[Node], float], *, absent: float) -> None:
        """`absent` is the value of nodes for which `derive` raises; its type (bool, int or float) is that of all values."""
        if type(absent) not in KINDS:
            raise TypeError(f"NodeFact {name!r}: `absent` must be a bool, an int or a float, got {absent!r}")
        if abs(absent) > INT64_MAX and type(absent) is int:
            raise ValueError(f"NodeFact {name!r}: `absent` must fit 64 bits, got {absent!r:.40}; write it as a float")
        self.name = name
        self.derive = derive
        self.of = derive
        """`derive`; guarded where a plugin of another author brings it."""
        self.absent = absent
        self.warned = False

    def __repr__(self) -> str:
        return f"NodeFact({self.name})"


class FactColumns:
    """The columns of all facts that plugins have read so far. Facts are told apart by identity, not by name."""

    __slots__ = ("_columns", "_rows")

    def __init__(self) -> None:
        self._columns: WeakKeyDictionary[NodeFact, npt.NDArray[Any]] = WeakKeyDictionary()
        self._rows = START_ROWS

    def __repr__(self) -> str:
        return f"FactColumns({sorted(fact.name for fact in self._columns)})"

    def column(self, fact: NodeFact, nodes: Sequence[Node | None]) -> npt.NDArray[Any]:
        """One value per row. `nodes` are the objects of all rows, None for holes: the column may have to be made."""
        found = self._columns.get(fact)
        if found is None:
            found = self._columns[fact] = np.full(self._rows, fact.absent)
            for row, node in enumerate(nodes):
                if node is not None:
                    _set(fact, found, row, node)
        return found

    def apply(self, row: int, node: Node) -> bool:
        """The node of a row is new or changed. True when a value did."""
        changed = False
        for fact, column in self._columns.items():
            changed |= _set(fact, column, row, node)
        return changed

    def remove(self, row: int) -> None:
        """The row is a hole now."""
        for fact, column in self._columns.items():
            column[row] = fact.absent

    def grow(self, rows: int) -> None:
        """Make room for `rows` rows."""
        for fact, column in list(self._columns.items()):
            self._columns[fact] = wider = grown(column, rows)
            wider[len(column) :] = fact.absent
        self._rows = rows


def _set(fact: NodeFact, column: npt.NDArray[Any], row: int, node: Node) -> bool:
    before = column.item(row)
    try:
        column[row] = fact.of(node)
    except (
        Exception,
        SystemExit,
    ):  # a mistake in one plugin's function must not lose the node; the log has the stack once
        column[row] = fact.absent
        if not fact.warned:
            fact.warned = True
            log.warning(
                "%r has no value for node %s, later ones are not logged", fact, node.metadata.name, exc_info=True
            )
    now = column.item(row)
    return bool(now != before) and not (np.isnan(now) and np.isnan(before))
