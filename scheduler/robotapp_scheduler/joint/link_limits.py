"""Access links: the flows between the pods of a row and those elsewhere share the row's link, as far as it is known what it carries."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from robotapp_scheduler.joint.latencies import BoolArray, FloatArray


def overloading(free_bps: FloatArray, peers: Mapping[int, int]) -> BoolArray:
    """Rows where a pod cannot be without overloading a link: its own there, or that of a peer it would not be beside.

    `free_bps` is what is left per row (infinite: not known), `peers` the bit/s of the pod's flows by the row of their other end.
    """
    total = sum(peers.values())
    blocked: BoolArray = (free_bps < total) & (total > 0)
    for row, bps in peers.items():
        blocked[row] = total > bps and bool(free_bps[row] < total - bps)
    crowded = [row for row, bps in peers.items() if bps > 0 and free_bps[row] < bps]
    if crowded:
        elsewhere = np.ones_like(blocked)
        if len(crowded) == 1:
            elsewhere[crowded[0]] = False
        blocked |= elsewhere
    return blocked


class LinkLimits(NamedTuple):
    """The flows of a problem's pods. A plan is a row per pod, negative for none."""

    free_bps: FloatArray
    """Per row what its link has left, infinite where that is not known."""
    pairs: tuple[tuple[int, int, int], ...]
    """(pod, pod, bit/s)."""
    ends: tuple[tuple[int, int, int], ...]
    """(pod, row of the other end, bit/s), of flows to what is placed already."""

    def over(self, plan: Sequence[int]) -> list[int]:
        """Rows whose link would carry more than it has left."""
        return [row for row, bps in self._crossing(plan, but=-1).items() if bps > self.free_bps[row]]

    def blocked(self, plan: Sequence[int], pod: int) -> BoolArray:
        """Rows where the pod cannot be, given where the others are."""
        peers: dict[int, int] = {}
        for left, right, bps in self.pairs:
            if pod in (left, right):
                row = plan[right if left == pod else left]
                if row >= 0:
                    peers[row] = peers.get(row, 0) + bps
        for own, row, bps in self.ends:
            if own == pod:
                peers[row] = peers.get(row, 0) + bps
        free_bps = self.free_bps.copy()
        for row, bps in self._crossing(plan, but=pod).items():
            free_bps[row] -= bps
        return overloading(free_bps, peers)

    def near(self, row: int, plan: Sequence[int]) -> list[int]:
        """Pods elsewhere that would relieve the row's link by coming to it."""
        there = {pod for pod, place in enumerate(plan) if place == row}
        found = {pod for pod, end, _ in self.ends if end == row}
        for left, right, _ in self.pairs:
            if left in there or right in there:
                found |= {left, right}
        return sorted(found - there)

    def _crossing(self, plan: Sequence[int], *, but: int) -> dict[int, int]:
        """Bit/s per row of the flows that leave it, without those of one pod."""
        used: dict[int, int] = {}
        flows = [(plan[left], plan[right], bps) for left, right, bps in self.pairs if but not in (left, right)]
        flows += [(plan[pod], row, bps) for pod, row, bps in self.ends if pod != but]
        for one, other, bps in flows:
            if one != other and one >= 0 and other >= 0:
                used[one] = used.get(one, 0) + bps
                used[other] = used.get(other, 0) + bps
        return used
