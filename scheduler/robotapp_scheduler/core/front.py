"""The best rows of a pod class as one decision saw them: kept as they are, put in order when somebody asks."""

from typing import Final, NamedTuple

import msgspec

from robotapp_scheduler.core.explain import Top


class Front(NamedTuple):
    """Up to TOP rows, none better than the first. Never changed: decisions that saw the same rows share it."""

    positions: tuple[int, ...]
    nodes: tuple[str, ...]
    totals: tuple[int, ...]
    weights: dict[str, int]
    """By plugin; of the same sums as long as it is the same object."""
    scores: dict[str, tuple[int, ...]]
    """Normalised, by plugin, in the order of `positions`."""
    shadow: tuple[str, ...]
    weight_bytes: int
    """What a `Top` of it takes, estimated from above."""


NOTHING: Final = Front((), (), (), {}, {}, (), 0)


class Finish(msgspec.Struct, frozen=True, gc=False):
    """The row that won, beside those at the front when it did."""

    front: Front
    position: int
    node: str
    total: int
    scores: dict[str, int]
    """Of the plugins that do not score all rows alike."""

    @property
    def weight_bytes(self) -> int:
        """What its `top` takes, estimated from above."""
        return self.front.weight_bytes

    def top(self) -> Top:
        """The winner first, then as many of the others as were at the front."""
        front = self.front
        others = [i for i, position in enumerate(front.positions) if position != self.position]
        del others[max(len(front.positions) - 1, 0) :]
        return Top(
            nodes=(self.node, *(front.nodes[i] for i in others)),
            totals=(self.total, *(front.totals[i] for i in others)),
            weights=front.weights,
            scores={
                plugin: (self.scores.get(plugin, values[0]), *(values[i] for i in others))
                for plugin, values in front.scores.items()
            },
            shadow=front.shadow,
        )
