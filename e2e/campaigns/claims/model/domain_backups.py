"""Snapshots of etcd in the domain model, and what is left of the present when it goes back to one.

Everything that was stored is as it was. What was not stored stays: containers, and what operator and scheduler remember of claims.
"""

from collections.abc import Iterator
from typing import Any

from campaigns.claims.model.domain_basis import (
    CHECKED,
    IDLE,
    PENDING,
    RESTING,
    RUNNING,
    TERMINATING,
    Basis,
    State,
    move,
)
from campaigns.claims.model.domain_rules import RESERVED
from campaigns.claims.model.explore import Move

_UP = {RUNNING, TERMINATING}


class Backups(Basis):
    def _backups(self, s: State) -> Iterator[Move]:
        if not s.restores:
            return
        if not s.snapshot:
            pods = tuple(sorted((h, x, PENDING if phase == CHECKED else phase) for h, x, phase in s.pods))
            snapshot = (s.apps, s.wants, s.claims, s.deployments, s.sets, pods, s.noted)
            yield move(s, "snapshot", False, snapshot=snapshot)
        else:
            yield move(s, "etcd is restored", False, **self._restored(s))

    def _restored(self, s: State) -> dict[str, Any]:
        """The state after a restore. Containers that nobody lists run on until their kubelet ends them.

        Left out are containers on an id that the snapshot shows in other hands: it was freed and granted again since, and no
        claim can hold back a pod that the snapshot itself brings back.
        """
        apps, wants, claims, deployments, sets, pods, noted = s.snapshot
        listed_pairs = {(h, x) for h, x, phase in pods if phase in _UP}
        running_pairs = {(h, x) for h, x, phase in s.pods if phase in _UP} | set(s.unlisted)
        ghosts = {(h, x) for h, x in running_pairs - listed_pairs if claims[x] is None or claims[x][0] == h}
        claims, noted = self._remembered(s, claims, noted)
        parts: dict[str, Any] = {
            "apps": apps,
            "wants": wants,
            "claims": claims,
            "deployments": deployments,
            "sets": sets,
            "pods": pods,
            "noted": noted,
            "unlisted": tuple(sorted(ghosts)),
            "confirmed": (),
            "manager": None,
            "restores": s.restores - 1,
            "snapshot": (),
        }
        if self.rules.starts_again():
            return parts | {"operators": (IDLE,) * self.operators, "sweepers": (RESTING,) * self.sweepers}
        checked_pairs = {(h, x) for h, x, phase in s.pods if phase == CHECKED}
        return parts | {"pods": tuple(sorted((h, x, CHECKED if (h, x) in checked_pairs else p) for h, x, p in pods))}

    def _remembered(
        self, s: State, claims: tuple[Any, ...], noted: tuple[int, ...]
    ) -> tuple[tuple[Any, ...], tuple[int, ...]]:
        """Claims and noted nodes after those that the processes remember were made again."""
        again, nodes = list(claims), set(noted)
        for x, claim in enumerate(s.claims):
            if claim is None:
                continue
            if again[x] is None and self.rules.makes_lost_claims():
                again[x] = (claim[0], RESERVED)
                nodes |= {x} & set(s.noted)
            elif again[x] is not None and again[x][0] == claim[0] and self.rules.notes_lost_nodes():
                nodes |= {x} & set(s.noted)
        return tuple(again), tuple(sorted(nodes))
