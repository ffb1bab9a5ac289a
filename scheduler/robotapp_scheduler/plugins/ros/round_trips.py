"""RTT of a pod's connections to every node, shared by the latency plugins."""

from collections.abc import Collection, Iterable
from typing import Final

import numpy as np

from robotapp_scheduler.core.api.ros import BALANCE_SHARE, Endpoint
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.nodes.columns import BoolArray, FloatArray
from robotapp_scheduler.core.robotics.rtt import ESTIMATED

NEUTRAL: Final = 50.0
"""Score of an unknown RTT, and of ROS pods without a budget."""


def nearest_us(nodes: Snapshot, endpoint: Endpoint, percentile: int | None = None) -> FloatArray:
    """RTT from the nearest node of the endpoint to every row, microseconds, NaN where unknown, infinite where unreachable."""
    wanted = endpoint.percentile if percentile is None else percentile
    rows = [nodes.rtt_from(name, wanted).rtt_us for name in endpoint.nodes]
    result = rows[0]
    for row in rows[1:]:
        result = np.fmin(result, row)  # fmin ignores NaN: a known way counts
    lost = np.isinf(result)
    if len(rows) > 1 and lost.any():  # a node of which nothing is known may be in reach
        result = np.where(lost & np.any([np.isnan(row) for row in rows], axis=0), np.nan, result)
    return result


def tightest(endpoints: Iterable[Endpoint], *, default_us: float = 0.0) -> Collection[Endpoint]:
    """Of those to the same nodes the one with the least budget, which decides: 256 topics to each of 32 pods can be there.

    default_us: the budget of those without one.
    """
    found: dict[tuple[tuple[str, ...], int], tuple[float, Endpoint]] = {}
    for endpoint in endpoints:
        key = (endpoint.nodes, endpoint.percentile)
        budget_us = default_us if endpoint.budget_us is None else endpoint.budget_us
        if key not in found or budget_us < found[key][0]:
            found[key] = budget_us, endpoint
    return [endpoint for _, endpoint in found.values()]


def margin_points(margin: FloatArray, *, balance: bool) -> FloatArray:
    """0…100 for the share of a limit that round trips leave (negative: exceeded, NaN: unknown).

    With `balance` all that keep the limit are worth nearly the same, so that other scores decide between them.
    """
    points = np.clip(100.0 * margin, 0.0, 100.0)
    if balance:
        points = np.where(margin < 0.0, 0.0, 100.0 - BALANCE_SHARE * (100.0 - points))
    found: FloatArray = np.where(np.isnan(margin), NEUTRAL, points)
    return found


def estimated(nodes: Snapshot, endpoint: Endpoint, rtt_us: FloatArray) -> BoolArray:
    """Rows whose time in `rtt_us`, made by `nearest_us`, is an estimate."""
    rows = [nodes.rtt_from(name, endpoint.percentile) for name in endpoint.nodes]
    found: BoolArray = np.any([(row.source == ESTIMATED) & (row.rtt_us == rtt_us) for row in rows], axis=0)
    return found
