"""The link quality of the last half hour, kept in memory, and its picture."""

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, isinf, isnan, nan
from typing import Final

SLOT_S: Final = 30
SLOTS: Final = 60
"""Half an hour."""
WIDTH: Final = 120
HEIGHT: Final = 24
_ROOM: Final = 2.0
_LEAST_SCALE_US: Final = 5000.0
"""Differences far below what a budget is made of are drawn as a flat line."""


class LinkHistory:
    """One value per node and half minute: the round trip's p95 in microseconds, infinite while unreachable."""

    def __init__(self) -> None:
        self._rows: dict[str, array[float]] = {}
        self._slot = 0

    def __repr__(self) -> str:
        return f"<LinkHistory {len(self._rows)} nodes>"

    def record(self, values: Mapping[str, float], now_s: float) -> None:
        """Takes the present values in. Several in one slot: the worst is kept. Nodes that are absent lose their row in time."""
        slot = int(now_s // SLOT_S)
        steps = slot - self._slot
        if steps > 0:
            self._advance(min(steps, SLOTS))
            self._slot = slot
        for node, value in values.items():
            row = self._rows.get(node)
            if row is None:
                row = self._rows[node] = array("f", [nan]) * SLOTS
            if isnan(row[-1]) or value > row[-1]:
                row[-1] = value

    def list_values(self, node: str) -> tuple[float | None, ...]:
        """Returns the values from the oldest to the newest, None where nothing was known."""
        row = self._rows.get(node)
        return () if row is None else tuple(None if isnan(value) else value for value in row)

    def _advance(self, steps: int) -> None:
        gap = array("f", [nan]) * steps
        for node, row in list(self._rows.items()):
            shifted_row = row[steps:] + gap
            if all(map(isnan, shifted_row)):
                del self._rows[node]
            else:
                self._rows[node] = shifted_row


@dataclass(frozen=True, slots=True)
class Sparkline:
    """`paths` are lines of an SVG of WIDTH by HEIGHT, `lost` the positions at which no probe was answered."""

    paths: tuple[str, ...]
    lost: tuple[str, ...]
    label: str


def draw_sparkline(values: tuple[float | None, ...]) -> Sparkline:
    """Returns the picture of a node's link: a gap where nothing is known, a mark where the other end was unreachable."""
    times = [value for value in values if value is not None and isfinite(value)]
    top = max(times, default=0.0)
    scale = max(top, _LEAST_SCALE_US)
    step = WIDTH / max(1, SLOTS - 1)
    paths: list[str] = []
    points: list[str] = []
    lost: list[str] = []
    for position, value in enumerate((*values, None)):
        if value is not None and isfinite(value):
            height = HEIGHT - _ROOM - (HEIGHT - 2 * _ROOM) * value / scale
            points.append(f"{position * step:.1f},{height:.1f}")
            continue
        if points:
            paths.append(_join_points(points))
            points = []
        if value is not None and isinf(value):
            lost.append(f"{position * step:.1f}")
    return Sparkline(tuple(paths), tuple(lost), _describe(times, len(lost)))


def _join_points(points: list[str]) -> str:
    """Returns the path's data; a single point becomes a short line, or it would not be seen."""
    return f"M{points[0]}h1.5" if len(points) == 1 else "M" + "L".join(points)


def _describe(times: list[float], lost: int) -> str:
    if not times and not lost:
        return "no measurement in the last 30 minutes"
    words = f"last 30 minutes: {min(times) / 1000:.3g} to {max(times) / 1000:.3g} ms" if times else "last 30 minutes"
    return f"{words}, unreachable {lost} times" if lost else words
