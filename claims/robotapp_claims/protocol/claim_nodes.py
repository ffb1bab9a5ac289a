"""Which nodes a domain claim names: those where its pods may run, so that it is parked when one of them vanishes.

Our scheduler writes a node before it binds a pod. Here the sweep adds those of pods that others have bound, and strikes
off nodes that no pod of the claim uses any more: else a node that was scaled down long ago would park the claim for ever.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Final

from robotapp_claims.protocol.sweep_snapshot import View
from robotapp_claims.protocol.writes import Api, note_nodes, strike_nodes
from robotapp_claims.rules.objects import Claim

IDLE_S: Final = 120.0
"""Least time for which a node has been seen without pods of the claim before it is struck off: a node that has lost contact
counts as ready for up to a minute."""


class Whereabouts:
    """Since when each node of a standing claim has had none of its pods, by this process's clock."""

    def __init__(self, client: Api, clock: Callable[[], float], counts: Counter[str]) -> None:
        self._client = client
        self._clock = clock
        self._counts = counts
        self._idle_since: dict[tuple[str, str], float] = {}

    def __repr__(self) -> str:
        return f"<Whereabouts: {len(self._idle_since)} idle nodes>"

    def start_pass(self, claims: Iterable[Claim]) -> None:
        named = {(claim.metadata.uid, node) for claim in claims for node in claim.status.nodes}
        self._idle_since = {key: since for key, since in self._idle_since.items() if key in named}

    async def follow(self, view: View, claim: Claim) -> None:
        """Bring the nodes of one standing domain claim up to date. The claim was read before the pods of the view."""
        if claim.spec.domain is None or not view.everywhere or not claim.holder.is_app:
            return
        using = view.usage.nodes(claim)
        if unknown := using - {"", *claim.status.nodes}:
            await note_nodes(self._client, claim, unknown)
            self._counts["NodesNoted"] += 1
            return
        idle = self._idle(claim, using)
        if "" in using:
            return
        idle = [node for node in idle if await view.is_ready(node)]
        if idle:
            await strike_nodes(self._client, claim, idle)
            self._counts["NodesStruck"] += 1

    def _idle(self, claim: Claim, using: Iterable[str]) -> list[str]:
        """Nodes that have had no pod of the claim for long."""
        now, busy = self._clock(), set(using)
        found = []
        for node in claim.status.nodes:
            key = (claim.metadata.uid, node)
            if node in busy:
                self._idle_since.pop(key, None)
            elif now - self._idle_since.setdefault(key, now) >= IDLE_S:
                found.append(node)
        return found
