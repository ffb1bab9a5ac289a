"""Round-trip times of an app's edges against their budgets: as measured, as published, and since when they are over or within.

Measured means: the agents measured this very pair of nodes; a measured time may be infinite, where no probe was answered.
Two ends on one node are 0.05 ms apart by definition, which is an estimate; what is neither is unknown here (estimates by zone
belong to the scheduler). What a pair's time is and when it is too old: `robotapp_api.values.placement.round_trips`.

Times change with every measurement, and a status that followed them would be written for ever. So everything people see
(edges, their order, conditions, summaries) is computed from published figures, which change seldom.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_api.model.app.edge import Edge
from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.placement.round_trips import MOVED, SAME_NODE, Figures, RoundTrips, is_unreachable
from robotapp_api.values.quantities.duration import parse_us

REST_S: Final = 60.0
"""Figures that moved are published at most this often, and so is a verdict that changes back and forth."""

EdgeKey = tuple[str, str, str, str]
"""(kind, topic, from, to)."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class EdgeView:
    """One edge of one instance. Times None: unknown; infinite: unreachable. `budget_us` None: no budget written.

    `judged_us` is the percentile the budget is about (50 or 95); `p95_us` is what status publishes.
    """

    edge: Edge
    nodes: tuple[str, str]
    budget_us: int | None
    p95_us: float | None
    judged_us: float | None
    measured: bool

    @property
    def key(self) -> EdgeKey:
        return self.edge.kind, self.edge.topic, self.edge.from_, self.edge.to

    @property
    def met(self) -> bool | None:
        if self.budget_us is None or self.judged_us is None:
            return None
        return self.judged_us <= self.budget_us

    @property
    def use(self) -> float:
        """Share of the budget in use; -1 when unknown, so that it sorts last."""
        return -1.0 if self.met is None else (self.judged_us or 0) / (self.budget_us or 1)

    @property
    def figures(self) -> tuple[float | None, float | None]:
        return self.p95_us, self.judged_us


@dataclasses.dataclass(slots=True)
class Rest:
    """One publication a minute in the long run, and one in advance for another verdict. Times are monotonic seconds."""

    figures_s: float = float("-inf")
    """From when figures that moved may be published."""

    @property
    def verdict_s(self) -> float:
        """From when another verdict may be published."""
        return self.figures_s - REST_S

    def publish(self, now_s: float) -> None:
        self.figures_s = max(self.figures_s, now_s) + REST_S

    def must_publish(self, now_s: float) -> None:
        """A publication that cannot wait."""
        self.figures_s = max(self.figures_s, now_s + REST_S)


class Published(NamedTuple):
    """Edges with the figures to show, worst first, and the second at which others may be shown (infinite: when they come)."""

    edges: tuple[EdgeView, ...]
    again_s: float


def edge_views(
    edges: tuple[Edge, ...], *, placed: Mapping[str, str], robot_node: str, round_trips: RoundTrips
) -> list[EdgeView]:
    """The edges as measured now, in the order of the spec. `placed`: component -> node of its pod."""
    return [_view(edge, {ROBOT_END: robot_node, **placed}, round_trips) for edge in edges]


def worst_first(views: Iterable[EdgeView]) -> tuple[EdgeView, ...]:
    return tuple(sorted(views, key=lambda view: (-view.use, view.key)))


def _view(edge: Edge, placed: Mapping[str, str], round_trips: RoundTrips) -> EdgeView:
    nodes = (placed.get(edge.from_, ""), placed.get(edge.to, ""))
    found = between(*nodes, round_trips) if all(nodes) else None
    percentile = edge.latency.percentile if edge.latency else 95
    return EdgeView(
        edge=edge,
        nodes=nodes,
        budget_us=parse_us(edge.latency.budget) if edge.latency else None,
        p95_us=found.p95_us if found else None,
        judged_us=found.of(percentile) if found else None,
        measured=found is not None and nodes[0] != nodes[1],
    )


def between(one: str, other: str, round_trips: RoundTrips) -> Figures | None:
    """What is known of the time between two nodes."""
    return SAME_NODE if one == other else round_trips.between(one, other)


def publish(
    measured: Sequence[EdgeView],
    before: Mapping[EdgeKey, EdgeView],
    rest: Rest,
    *,
    now_s: float,
    lasts_from_s: Callable[[EdgeView], float] = lambda _: float("-inf"),
) -> Published:
    """What to show of one instance, given what was shown `before`; `rest` is brought up to date.

    At once: another place, a first figure, one that is unknown again. Another verdict when it has lasted, but not back and
    forth. With these, or after a minute: figures that moved by a fifth.
    lasts_from_s: the second from which an edge's verdict counts.
    """
    must = {view.key for view in measured if _must_be_shown(view, before.get(view.key))}
    turning = [view for view in measured if view.key not in must and _flips(view, before[view.key])]
    ripe_s = {view.key: _ripe_s(view, before[view.key], lasts_from_s) for view in turning}
    flips = {key for key, from_s in ripe_s.items() if from_s <= now_s}
    moved = {view.key for view in measured if view.key not in must and _has_moved(view, before[view.key])} - set(ripe_s)
    turn = bool(flips) and now_s >= rest.verdict_s
    move = bool(moved) and (turn or bool(must) or now_s >= rest.figures_s)
    show = must | (flips if turn else set()) | (moved if move else set())
    if turn or (move and not must):
        rest.publish(now_s)
    elif any(view.figures != (None, None) for view in measured if view.key in must):
        rest.must_publish(now_s)
    edges = worst_first(view if view.key in show else _with_figures_of(before[view.key], view) for view in measured)
    due = ([] if turn or not flips else [rest.verdict_s]) + ([] if move or not moved else [rest.figures_s])
    due += [from_s for key, from_s in ripe_s.items() if key not in flips]
    return Published(edges, min(due, default=float("inf")))


def _must_be_shown(view: EdgeView, before: EdgeView | None) -> bool:
    """Has anything but the figures changed?"""
    if before is None:
        return True
    if (view.nodes, view.edge.latency, view.measured) != (before.nodes, before.edge.latency, before.measured):
        return True
    return any((one is None) != (other is None) for one, other in zip(view.figures, before.figures, strict=True))


def _flips(view: EdgeView, before: EdgeView) -> bool:
    """From met to exceeded or back."""
    return view.met != before.met


def _ripe_s(view: EdgeView, before: EdgeView, lasts_from_s: Callable[[EdgeView], float]) -> float:
    """From when another verdict may be shown. An end that answers again is no slow round either."""
    return float("-inf") if is_unreachable(before.judged_us) else lasts_from_s(view)


def _has_moved(view: EdgeView, before: EdgeView) -> bool:
    return any(
        now_us is not None and before_us is not None and abs(now_us - before_us) >= MOVED * before_us > 0
        for now_us, before_us in zip(view.figures, before.figures, strict=True)
    )


def _with_figures_of(shown: EdgeView, view: EdgeView) -> EdgeView:
    """The edge of today's spec with the figures shown before."""
    return dataclasses.replace(shown, edge=view.edge)


class Since(NamedTuple):
    """From when (monotonic seconds) an edge between these nodes has been within its budget (met) or over it."""

    met: bool
    nodes: tuple[str, str]
    budget_us: int | None
    from_s: float


@dataclasses.dataclass(slots=True)
class BudgetTimes:
    """Since when each edge of one instance has been over or within its budget.

    One slow round changes no condition and moves nothing: a budget counts as exceeded after it was exceeded for
    `placement.reschedule.for`, and as met again after as long. Unknown times end both: an edge that was not measured for a while
    begins again. The times are kept in memory: after a restart of the operator both are counted anew, so a restart can only
    delay conditions and moves.
    """

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
