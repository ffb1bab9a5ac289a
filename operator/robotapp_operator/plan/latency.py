"""Round-trip times of an app's edges against their budgets.

Measured means: the agents measured this very pair of nodes. Two ends on one node are 0.05 ms apart by definition; what is
neither is unknown here (zone estimates belong to the scheduler's model and to `explain`).
"""

import dataclasses
from collections.abc import Mapping
from typing import Final

from robotapp_api.model.edge import Edge, Percentile
from robotapp_api.model.names import ROBOT_END
from robotapp_api.values.duration import parse_us
from robotapp_operator.plan.objects import Telemetry

SAME_NODE_US: Final = 50


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class EdgeView:
    """One edge of one instance. Times None: unknown. `budget_us` None: no budget written.

    `judged_us` is the percentile the budget is about (50 or 95); `p95_us` is what status publishes.
    """

    edge: Edge
    nodes: tuple[str, str]
    budget_us: int | None
    p95_us: int | None
    judged_us: int | None
    measured: bool

    @property
    def met(self) -> bool | None:
        if self.budget_us is None or self.judged_us is None:
            return None
        return self.judged_us <= self.budget_us

    @property
    def use(self) -> float:
        """Share of the budget in use; -1 when unknown, so that it sorts last."""
        return -1.0 if self.met is None else (self.judged_us or 0) / (self.budget_us or 1)


def edge_views(
    edges: tuple[Edge, ...], *, placed: Mapping[str, str], robot_node: str, telemetry: Mapping[str, Telemetry]
) -> list[EdgeView]:
    """`placed`: component -> node of its pod. Worst first."""
    views = [_view(edge, {ROBOT_END: robot_node, **placed}, telemetry) for edge in edges]
    return sorted(views, key=lambda view: (-view.use, view.edge.topic, view.edge.from_, view.edge.to))


def round_trip_us(
    one: str, other: str, telemetry: Mapping[str, Telemetry], *, percentile: Percentile = 95
) -> int | None:
    """Worse of the two directions in microseconds, None when neither was measured."""
    if one == other:
        return SAME_NODE_US
    found = [
        time_us
        for near, far in ((one, other), (other, one))
        if near in telemetry and (time_us := telemetry[near].time_to(far, percentile)) is not None
    ]
    return max(found, default=None)


def _view(edge: Edge, placed: Mapping[str, str], telemetry: Mapping[str, Telemetry]) -> EdgeView:
    nodes = (placed.get(edge.from_, ""), placed.get(edge.to, ""))
    known = all(nodes)
    p95_us = round_trip_us(*nodes, telemetry) if known else None
    percentile = edge.latency.percentile if edge.latency else 95
    return EdgeView(
        edge=edge,
        nodes=nodes,
        budget_us=parse_us(edge.latency.budget) if edge.latency else None,
        p95_us=p95_us,
        judged_us=round_trip_us(*nodes, telemetry, percentile=percentile) if known else None,
        measured=p95_us is not None and nodes[0] != nodes[1],
    )


def steady_p95(previous_us: int | None, now_us: int | None, *, verdict_changed: bool, rested: bool) -> int | None:
    """The figure to publish: the old one until the verdict changes, or it moved by 20 % and a minute has passed."""
    if previous_us is None or now_us is None or verdict_changed:
        return now_us
    moved = abs(now_us - previous_us) >= 0.2 * previous_us
    return now_us if moved and rested else previous_us
