"""How much of the storage a node offers a pod's claims would use: fuller is worse, unless the shape says otherwise."""

from collections.abc import Sequence

import numpy as np

from robotapp_scheduler.core.api.storage_v1 import bytes_of
from robotapp_scheduler.core.nodes.columns import LARGEST, BoolArray, IntArray
from robotapp_scheduler.core.volumes.volume_cache import Volumes
from robotapp_scheduler.plugins.kubernetes.node_resources.scoring_strategies import half_away, percent
from robotapp_scheduler.plugins.kubernetes.volumes.matching import Match


class _ClassUsage:
    """Requested and offered bytes per node for one storage class."""

    def __init__(self, rows: int) -> None:
        self.there: BoolArray = np.zeros(rows, dtype=np.bool_)
        self.requested: IntArray = np.zeros(rows, dtype=np.int64)
        self.offered: IntArray = np.zeros(rows, dtype=np.int64)


def score(match: Match, store: Volumes, points: Sequence[int]) -> IntArray:
    """0…100 per node: the mean over classes of `points[used percent]`, 0 where no volume is chosen.

    Volumes that exist count where there are any, else the room that was reported for those to be made.
    """
    rows = len(match.bits)
    existing = _existing(match, store, rows)
    some: BoolArray = np.zeros(rows, dtype=np.bool_)
    for sums in existing:
        some |= sums.there
    total, count = np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=np.int64)
    table = np.array(points, dtype=np.int64)
    to_make = _to_make(match, rows)
    for sums, rows_that_count in [(s, s.there) for s in existing] + [(s, s.there & ~some) for s in to_make]:
        full = (sums.offered == 0) | (sums.requested > sums.offered)
        used = np.where(full, 100, percent(np.minimum(sums.requested, sums.offered), sums.offered))
        total += np.where(rows_that_count, table[used], 0)
        count += rows_that_count
    return half_away(total / np.maximum(count, 1))


def _existing(match: Match, store: Volumes, rows: int) -> list[_ClassUsage]:
    classes: dict[str, _ClassUsage] = {}
    for claim, volumes, chosen in match.given:
        where = chosen >= 0
        if not where.any():
            continue
        sums = classes.setdefault(claim.class_name, _ClassUsage(rows))
        sizes = np.array([min(store.sizes[volume.metadata.name], LARGEST) for volume in volumes], dtype=np.int64)
        sums.there |= where
        sums.requested[where] += min(claim.wants_bytes, LARGEST)
        sums.offered[where] += sizes[chosen[where]]
    return list(classes.values())


def _to_make(match: Match, rows: int) -> list[_ClassUsage]:
    classes: dict[str, _ClassUsage] = {}
    for claim, possible, capacities, chosen in match.made:
        where = possible & (chosen >= 0)
        if not where.any():
            continue
        sums = classes.setdefault(claim.spec.storage_class_name or "", _ClassUsage(rows))
        rooms = np.array(
            [min(bytes_of({"storage": capacity.capacity or 0}), LARGEST) for capacity in capacities], dtype=np.int64
        )
        sums.there |= where
        sums.requested[where] += min(claim.wants_bytes, LARGEST)
        # Not added up: claims of one class share the room of a node.
        sums.offered[where] = rooms[chosen[where]]
    return list(classes.values())
