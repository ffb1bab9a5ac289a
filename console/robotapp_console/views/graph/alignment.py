"""Places the cells of a lane near what they are linked to, without changing their order: lines become short and nearly straight."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor


@dataclass(frozen=True, slots=True)
class DesiredPlace:
    """The top that a cell of this height would have if it were alone; `weight` counts the lines that draw it there."""

    height: float
    top: float = 0.0
    weight: float = 0.0


def place_cells(desired_places: Sequence[DesiredPlace], depth: float) -> list[float]:
    """Returns the tops that are nearest to the desired ones (least squares) for cells in this order that do not overlap.

    With the heights of the cells above taken off each top, the order is all that is left of the condition: tops must not
    decrease. So neighbours whose desired tops contradict each other are merged into one with the mean of both. A cell without
    lines hardly counts. All stay between 0 and `depth`.
    """
    offsets = [0.0]
    for place in desired_places:
        offsets.append(offsets[-1] + place.height)
    blocks: list[tuple[float, float, int]] = []
    for place, offset in zip(desired_places, offsets, strict=False):
        value, weight, count = place.top - offset, place.weight or 1e-6, 1
        while blocks and blocks[-1][0] > value:
            other_value, other_weight, other_count = blocks.pop()
            value = (value * weight + other_value * other_weight) / (weight + other_weight)
            weight, count = weight + other_weight, count + other_count
        blocks.append((value, weight, count))
    slack = max(0.0, depth - offsets[-1])
    values = [min(max(value, 0.0), slack) for value, _, count in blocks for _ in range(count)]
    return [floor(value) + offset for value, offset in zip(values, offsets, strict=False)]
