"""Places the cells of a lane near what they are linked to, without changing their order: lines become short and nearly straight."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor


@dataclass(frozen=True, slots=True)
class Wish:
    """The top that a cell of this height would have if it were alone; `weight` counts the lines that wish it."""

    height: float
    top: float = 0.0
    weight: float = 0.0


def place_cells(wishes: Sequence[Wish], depth: float) -> list[float]:
    """Returns the tops that are nearest to the wishes (least squares) for cells in this order that do not overlap.

    With the heights of the cells above taken off each top, the order is all that is left of the condition: tops must not
    decrease. So neighbours whose wishes contradict each other are merged into one with the mean of both. A cell without a
    wish hardly counts. All stay between 0 and `depth`.
    """
    offsets = [0.0]
    for wish in wishes:
        offsets.append(offsets[-1] + wish.height)
    blocks: list[tuple[float, float, int]] = []
    for wish, offset in zip(wishes, offsets, strict=False):
        value, weight, count = wish.top - offset, wish.weight or 1e-6, 1
        while blocks and blocks[-1][0] > value:
            other_value, other_weight, other_count = blocks.pop()
            value = (value * weight + other_value * other_weight) / (weight + other_weight)
            weight, count = weight + other_weight, count + other_count
        blocks.append((value, weight, count))
    slack = max(0.0, depth - offsets[-1])
    values = [min(max(value, 0.0), slack) for value, _, count in blocks for _ in range(count)]
    return [floor(value) + offset for value, offset in zip(values, offsets, strict=False)]
