"""Since when each edge of an instance has been over or within its budget.

One slow round changes no condition and moves nothing: a budget counts as exceeded after it was exceeded for
`placement.reschedule.for`, and as met again after as long. The times are kept in memory: after a restart of the operator both
are counted anew, so a restart can only delay conditions and moves.
"""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

from robotapp_api.values.round_trips import is_unreachable
from robotapp_operator.plan.status.latency import EdgeKey, EdgeView


class Since(NamedTuple):
    """From when (monotonic seconds) an edge between these nodes has been within its budget (met) or over it."""

    met: bool
    nodes: tuple[str, str]
    budget_us: int | None
    from_s: float


@dataclasses.dataclass(slots=True)
class BudgetTimes:
    """Of one instance. Unknown times end both: an edge that was not measured for a while begins again."""

    edges: dict[EdgeKey, Since] = dataclasses.field(default_factory=dict)

    def look(self, measured: Iterable[EdgeView], *, now_s: float) -> None:
        """Take in what is measured now."""
        before, self.edges = self.edges, {}
        for view in measured:
            if view.met is None:
                continue
            found = Since(view.met, view.nodes, view.budget_us, now_s)
            known = before.get(view.key, found)
            self.edges[view.key] = known if known[:3] == found[:3] else found

    def lasts_from_s(self, view: EdgeView, *, for_s: float) -> float:
        """The second from which the edge's present side of its budget counts; infinite while it has none.

        No answer at all is no slow round: it counts at once.
        """
        since = self.edges.get(view.key)
        if since is None or since.met != view.met:
            return float("inf")
        return since.from_s if is_unreachable(view.judged_us) else since.from_s + for_s
