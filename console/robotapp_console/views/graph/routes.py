"""Path data of lines: around the right side of a lane, or as curves from lane to lane, with an arrow where they arrive."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

ARROW: Final = 7
_HALF_ARROW: Final = 4
BEND: Final = 5
"""Radius of the corners of a loop."""


@dataclass(frozen=True, slots=True)
class End:
    """One end of a line: its place, and the side of the component it is on: 1 for right, -1 for left."""

    x: float
    y: float
    side: int


@dataclass(frozen=True, slots=True)
class Crossing:
    """The way from one lane to the next: a curve from `begin` to `end`, which are x, ending in the row `y`."""

    begin: float
    end: float
    y: float


def draw_loop(source: End, target: End, turn: float) -> str:
    """Returns the line that turns at x = `turn` to another component of the lane."""
    if source.y == target.y:
        return f"M{source.x:g} {source.y:g}H{turn:g}"
    bend = BEND if target.y > source.y else -BEND
    return (
        f"M{source.x:g} {source.y:g}H{turn - BEND:g}Q{turn:g} {source.y:g} {turn:g} {source.y + bend:g}"
        f"V{target.y - bend:g}Q{turn:g} {target.y:g} {turn - BEND:g} {target.y:g}H{target.x:g}"
    )


def draw_curves(source: End, target: End, crossings: Iterable[Crossing]) -> str:
    """Returns the line from lane to lane, straight through the lanes between its ends."""
    line, y = f"M{source.x:g} {source.y:g}", source.y
    for crossing in crossings:
        middle = (crossing.begin + crossing.end) / 2
        line += f"H{crossing.begin:g}C{middle:g} {y:g} {middle:g} {crossing.y:g} {crossing.end:g} {crossing.y:g}"
        y = crossing.y
    return f"{line}H{target.x:g}"


def draw_arrow(target: End) -> str:
    """Returns the head of the line: a triangle that touches the component."""
    back = target.x + target.side * ARROW
    return f"M{back:g} {target.y - _HALF_ARROW:g}L{target.x:g} {target.y:g}L{back:g} {target.y + _HALF_ARROW:g}z"
