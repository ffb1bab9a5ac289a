"""The best nodes of a pod class at the time of a decision; they are put in order only when a record is read."""

from typing import Final, NamedTuple

import msgspec

from robotapp_scheduler.core.explain.record import Top


class Scorers(NamedTuple):
    """The plugins that score such pods. The same object as long as the same plugins do."""

    weights: dict[str, int]
    """By plugin, in the order of the profile."""
    shadows: tuple[str, ...]
    alike: dict[str, int]
    """What those say that score all rows alike."""
    apart: tuple[str, ...]
    """The others."""


class NodePluginScores(msgspec.Struct, frozen=True, gc=False):
    """One row: its node, its total, and the normalised scores of `Scorers.apart`, in that order."""

    position: int
    node: str
    total: int
    scores: tuple[int, ...]


class TopNodes(NamedTuple):
    """Up to TOP rows, none better than the first. Never changed: decisions that saw the same rows share it."""

    positions: tuple[int, ...]
    sights: tuple[NodePluginScores, ...]
    scorers: Scorers
    weight_bytes: int
    """What a `Top` of it takes, estimated from above."""


NOTHING: Final = TopNodes((), (), Scorers({}, (), {}, ()), 0)


class ChosenNode(msgspec.Struct, frozen=True, gc=False):
    """The row that won, beside those at the front when it did."""

    front: TopNodes
    chosen: NodePluginScores

    @property
    def weight_bytes(self) -> int:
        """What its `top` takes, estimated from above."""
        return self.front.weight_bytes

    def top(self) -> Top:
        """The winner first, then as many of the others as were at the front."""
        sights, scorers = self.front.sights, self.front.scorers
        others = [sight for sight in sights if sight.position != self.chosen.position]
        shown = [self.chosen, *others[: max(len(sights) - 1, 0)]]
        apart = dict(zip(scorers.apart, zip(*(sight.scores for sight in shown), strict=True), strict=False))
        return Top(
            nodes=tuple(sight.node for sight in shown),
            totals=tuple(sight.total for sight in shown),
            weights=scorers.weights,
            scores={
                plugin: apart[plugin] if plugin in apart else (scorers.alike[plugin],) * len(shown)
                for plugin in scorers.weights
            },
            shadow=scorers.shadows,
        )
