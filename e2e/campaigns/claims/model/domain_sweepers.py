"""Sweepers of the domain model: rule 2."""

from collections.abc import Iterator
from typing import Any

from campaigns.claims.model.domain_basis import (
    DEPLOYMENT,
    LIVE,
    POD,
    REPLICA_SET,
    RESTING,
    Basis,
    State,
    move,
    put,
    swap,
)
from campaigns.claims.model.domain_rules import AUTO, DRAINING, NONE, PARKED
from campaigns.claims.model.explore import Move
from robotapp_claims.rules.release import Release

NODES, RELEASE = 5, 6
"""Last stages of a release: unused and unwanted, the sweeper reads the nodes, after the pods, and then writes."""
STRIKE = 7
"""First stage of striking off the node of a claim that stands: pods are read, then the node, then the claim is written."""


class Sweepers(Basis):
    def _sweeper(self, s: State, k: int, sweeper: tuple[Any, ...]) -> Iterator[Move]:
        if sweeper == RESTING:
            if self.pods_first:
                yield from self._list_pods_first(s, k)
                return
            for x, claim in enumerate(s.claims):
                if claim:
                    yield from self._begin(s, k, x, claim)
                if claim and x in s.noted:
                    to = (x, STRIKE, *claim, (), NONE)
                    yield move(s, f"S reads id{x} for its node", True, sweepers=self._sweeps(s, k, to))
            yield from self._repair(s)
            return
        yield move(s, "S dies", False, sweepers=self._sweeps(s, k))
        x, stage, h, phase, _, unseen = sweeper
        if x == -2:
            yield from self._with_old_pods(s, k, stage)
        elif stage == NODES and self.follows_nodes:
            seen = (x, RELEASE, h, phase, (), int(self._unseen(s, h, x)))
            yield move(s, f"S reads nodes for id{x}", True, sweepers=self._sweeps(s, k, seen))
        elif stage >= STRIKE:
            yield from self._strike(s, k, sweeper)
        elif stage >= NODES:
            yield from self._release(s, k, x, h, phase, unseen=stage == RELEASE and bool(unseen))
        else:
            yield from self._look(s, k, sweeper)

    def _repair(self, s: State) -> Iterator[Move]:
        """A true pod never runs without its claim (LOST), so every repair there could be is the attacker's doing."""
        for what, h, x, how in s.forged:
            if what == POD and s.claims[x] is None and self.rules.repairs(self.who[h], x, how, self._state(s, h)):
                changed = {"claims": put(s.claims, x, (h, 0)), "operators": self._ops(s, claim=x)}
                yield move(s, f"!FORGED: S makes id{x} for h{h}, whose pod is {how}", True, **changed)

    def _begin(self, s: State, k: int, x: int, claim: tuple[int, int]) -> Iterator[Move]:
        """Claims read; what the instance held, and soon named, is remembered for the question who wants.

        Unless `apart`, the Deployments are read in the same step: between the two only the claim itself could matter,
        and a change of it refuses this sweeper anyway. The `apart` scenarios check that this saves states, not errors.
        """
        h, phase = claim
        held = tuple(number for number, _ in self._own(s, h))
        if self.apart:
            yield move(s, f"S reads id{x}", True, sweepers=self._sweeps(s, k, (x, 1, h, phase, held, NONE)))
            return
        seen = (x, 2, h, phase, *self._memory(s, h, x, held))
        if self.rules.error_means_gone():
            yield move(
                s,
                f"S refused, takes holder of id{x} for gone",
                False,
                sweepers=self._sweeps(s, k, (*seen[:1], 5, *seen[2:])),
            )
        yield from self._judge(s, k, seen, wanted=False, used=self._used(s, 1, h, x))

    def _look(self, s: State, k: int, sweeper: tuple[Any, ...]) -> Iterator[Move]:
        x, stage, h, phase, held, named = sweeper
        used = stage < 4 and self._used(s, stage, h, x)
        wanted = stage == 4 and self.rules.wants(
            self.who[h], x, held, named, s.wants[h] if self._state(s, h) == LIVE else None
        )
        memory = self._memory(s, h, x, held) if stage == 1 else (held, named)
        following = (x, stage + 1, h, phase, *memory)
        yield from self._judge(s, k, following, wanted=wanted, used=used)

    def _memory(self, s: State, h: int, x: int, held: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
        """What to remember of (held, named) until the app is read: one of two pairs that give the same answers.

        An app that asks for an id decides by that id alone; one that takes any id only needs to know whether x comes first.
        """
        if self.rules.wants(self.who[h], x, held, self._named(s, h), AUTO):
            return (x,), NONE
        other = next(number for number in held if number != x)
        return (x, other), other

    def _used(self, s: State, stage: int, h: int, x: int) -> bool:
        """Stage 1 Deployments, 2 ReplicaSets, 3 pods."""
        who, state = self.who[h], self._state(s, h)
        if stage == 1:
            found = tuple((self.who[d[0]], d[1]) for d in s.deployments if d)
            return self.rules.uses_deployments(who, x, found, state, self._forged(s, DEPLOYMENT))
        if stage == 2:
            sets = ((divmod(i, self.ids), v) for i, v in enumerate(s.sets) if v)
            up = tuple((self.who[i[0]], i[1], int(v == 1)) for i, v in sets)
            return self.rules.uses_sets(who, x, up, state, self._forged(s, REPLICA_SET))
        return self.rules.uses_pods(
            who, x, tuple(sorted({(self.who[p[0]], p[1]) for p in s.pods})), self._forged(s, POD)
        )

    def _judge(self, s: State, k: int, following: tuple[Any, ...], *, wanted: bool, used: bool) -> Iterator[Move]:
        x, stage, h, phase, *_ = following
        decision = self.rules.keeps(phase, wanted, used)
        if decision is Release.RESTORE:
            if s.claims[x] == (h, phase):
                changed = self._claim_changed(s, x, (h, 0)) | {"operators": self._ops(s, claim=x)}
                yield move(s, f"S restores id{x}", True, sweepers=self._sweeps(s, k, claim=x), **changed)
            else:
                yield move(s, "S refused", True, sweepers=self._sweeps(s, k))
        elif decision is Release.KEEP:
            yield move(s, f"S keeps id{x}", True, sweepers=self._sweeps(s, k))
        else:
            yield move(s, f"S id{x} unused ({stage - 1})", True, sweepers=self._sweeps(s, k, following))

    def _release(self, s: State, k: int, x: int, h: int, phase: int, *, unseen: bool) -> Iterator[Move]:
        decision = self.rules.keeps(phase, False, False, unseen)
        if decision is Release.KEEP:
            yield move(s, f"S keeps id{x}", True, sweepers=self._sweeps(s, k))
        elif decision is Release.DELETE:
            changed = self._claim_changed(s, x, None, forget_node=True) | {"operators": self._ops(s, claim=x)}
            yield move(s, f"S deletes id{x}", True, sweepers=self._sweeps(s, k, claim=x, gone=True), **changed)
        elif s.claims[x] == (h, phase):
            to, what = (PARKED, "parks") if decision is Release.PARK else (DRAINING, "drains")
            changed = self._claim_changed(s, x, (h, to)) | {"operators": self._ops(s, claim=x)}
            yield move(s, f"S {what} id{x}", True, sweepers=self._sweeps(s, k, claim=x), **changed)
        else:
            yield move(s, "S refused", True, sweepers=self._sweeps(s, k))

    def _strike(self, s: State, k: int, sweeper: tuple[Any, ...]) -> Iterator[Move]:
        """Any pod of the instance, pending ones too, may be on the node or on its way there."""
        x, stage, h, phase, *_ = sweeper
        if stage == STRIKE + 2:
            changed = {"noted": swap(s.noted, x), "operators": self._ops(s, claim=x)}
            yield move(s, f"S strikes the node of id{x} off", True, sweepers=self._sweeps(s, k, claim=x), **changed)
        elif self._unseen(s, h, x) if stage > STRIKE else any(pod[:2] == (h, x) for pod in s.pods):
            yield move(s, f"S keeps the node of id{x}", True, sweepers=self._sweeps(s, k))
        else:
            to = (x, stage + 1, h, phase, (), NONE)
            yield move(s, f"S strikes id{x} ({stage})", True, sweepers=self._sweeps(s, k, to))

    def _list_pods_first(self, s: State, k: int) -> Iterator[Move]:
        pairs = [(h, x) for h in range(len(self.names)) for x in range(self.ids)]
        unused = sum(1 << (h * self.ids + x) for h, x in pairs if not self._used(s, 3, h, x))
        yield move(s, "S lists pods", True, sweepers=self._sweeps(s, k, (-2, unused, 0, 0, (), NONE)))

    def _with_old_pods(self, s: State, k: int, unused: int) -> Iterator[Move]:
        yield move(s, "S again", True, sweepers=self._sweeps(s, k))
        for x, claim in enumerate(s.claims):
            if claim is None or not unused >> (claim[0] * self.ids + x) & 1:
                continue
            h, phase = claim
            held = tuple(number for number, _ in self._own(s, h))
            want = s.wants[h] if self._state(s, h) == LIVE else None
            wanted = self.rules.wants(self.who[h], x, held, self._named(s, h), want)
            if not wanted and not self._used(s, 1, h, x):
                to = (x, 5, h, phase, held, NONE)
                yield move(s, f"S id{x} unused", True, sweepers=self._sweeps(s, k, to))
