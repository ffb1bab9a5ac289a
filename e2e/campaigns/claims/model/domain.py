"""Model of domain claims: RobotApp instances, operators, a lagging controller-manager, scheduler, sweepers, people.

Every interleaving; every process may die or sleep between any two steps. When an object changes, whoever holds its
version for a conditional write falls back to idle: that write would be refused and change nothing. So runs are unbounded;
only people's changes, pods, ids and processes are bounded.

DOUBLE  two live pods of different instances with one id     LOST  a live pod whose claim is missing or another's
A container that runs on out of sight, without a pod object, counts as a live pod.
FORGED  a claim made for a pod that only says whose it is
FLAP    a template moved although its instance holds the id it has     DUP  two claims for an instance without rival
"""

from collections.abc import Iterator
from itertools import product
from typing import Any

from campaigns.claims.model.domain_backups import Backups
from campaigns.claims.model.domain_basis import (
    CHECKED,
    DELETED,
    DEPLOYMENT,
    IDLE,
    LIVE,
    ORPHANED,
    PENDING,
    POD,
    REPLICA_SET,
    RESTING,
    RUNNING,
    TERMINATING,
    TO_COME,
    State,
    move,
    put,
    swap,
)
from campaigns.claims.model.domain_operators import Operators
from campaigns.claims.model.domain_rules import ALONE, AUTO, ELSEWHERE, NONE, PARKED
from campaigns.claims.model.domain_sweepers import Sweepers
from campaigns.claims.model.explore import Move


class DomainModel(Operators, Sweepers, Backups):
    """The whole: people, garbage collector, controllers, kubelets, scheduler, operators, sweepers; and what must hold."""

    def moves(self, s: State) -> Iterator[Move]:
        yield from self._people(s)
        yield from self._attacker(s)
        yield from self._pods(s)
        yield from self._nodes(s)
        yield from self._backups(s)
        yield from self._manager(s)
        yield from self._sets(s)
        for k, operator in enumerate(s.operators):
            if not k or operator != s.operators[k - 1]:
                yield from self._operator(s, k, operator)
        for k, sweeper in enumerate(s.sweepers):
            if not k or sweeper != s.sweepers[k - 1]:
                yield from self._sweeper(s, k, sweeper)

    # People and the garbage collector

    def _people(self, s: State) -> Iterator[Move]:
        for name, found in enumerate(s.deployments):
            if found and self._state(s, found[0]) == DELETED:
                yield move(s, f"garbage Deployment {name}", True, **self._set_deployment(s, found[0], None))
        if TO_COME in s.apps and s.apps[0] != LIVE:
            yield move(s, "app created again", True, apps=put(s.apps, s.apps.index(TO_COME), LIVE))
        if not s.changes:
            return
        left = s.changes - 1
        for app, state in enumerate(s.apps):
            if state == LIVE:
                yield move(s, f"delete app{app}", False, changes=left, apps=put(s.apps, app, DELETED))
                # Taking the owner reference off bumps the Deployment: conditional writes to it fail.
                fallen = tuple(sorted(IDLE if op != IDLE and self._touches(s, op, app) else op for op in s.operators))
                orphaned = put(s.apps, app, ORPHANED)
                yield move(s, f"orphan app{app}", False, changes=left, apps=orphaned, operators=fallen)
        for h in range(len(self.names)):
            if self._state(s, h) == LIVE:
                for want in set(self.specs) - {s.wants[h]}:
                    yield move(s, f"h{h} wants {want}", False, changes=left, wants=put(s.wants, h, want))
            elif self._state(s, h) == ORPHANED and self._deployment(s, h):
                yield move(s, f"delete orphan h{h}", False, changes=left, **self._set_deployment(s, h, None))

    def _attacker(self, s: State) -> Iterator[Move]:
        """Writes look-alikes of what any instance may have. A live pod of the instance's own namespace is no look-alike."""
        if len(s.forged) >= self.forgeries:
            return
        for kind, how in product((DEPLOYMENT, REPLICA_SET, POD), (ELSEWHERE, ALONE)):
            for h, x in product(range(len(self.names)), range(self.ids)):
                one = (kind, h, x, how)
                if (kind, how) != (POD, ALONE) and one not in s.forged:
                    yield move(s, f"attacker forges {one}", False, forged=swap(s.forged, None, one))

    def _touches(self, s: State, op: tuple[Any, ...], app: int) -> bool:
        return self.fenced and self.apps[op[1]] == app and s.deployments[self.names[op[1]]] is not None

    # Pods and the scheduler

    def _pods(self, s: State) -> Iterator[Move]:
        for pod in sorted(set(s.pods)):
            h, x, phase = pod
            if phase == RUNNING:
                yield move(s, f"evict {pod}", False, pods=swap(s.pods, pod, (h, x, TERMINATING)))
            elif phase == TERMINATING:
                yield move(s, f"{pod} ends", True, pods=swap(s.pods, pod))
            else:
                yield move(s, f"delete {pod}", False, pods=swap(s.pods, pod))
                if phase == PENDING and self._allowed(s, h, x):
                    checked = {"pods": swap(s.pods, pod, (h, x, CHECKED))} | self._note(s, x)
                    yield move(s, f"claim of {pod} seen", True, **checked)
                if phase == CHECKED:
                    yield move(s, f"bind {pod}", True, pods=swap(s.pods, pod, (h, x, RUNNING)))
                    yield move(s, "scheduler dies", False, pods=swap(s.pods, pod, (h, x, PENDING)))

    def _allowed(self, s: State, h: int, x: int) -> bool:
        claim = s.claims[x]
        holder, phase = (self.who[claim[0]], claim[1]) if claim else (None, 0)
        return self.rules.may_bind(self.who[h], x, holder, phase, self._state(s, h))

    def _note(self, s: State, x: int) -> dict[str, Any]:
        """The bind check writes the node into the claim, every time, so that whoever has read the claim before is refused."""
        if not self.follows_nodes or not self.rules.notes_node(x in s.noted):
            return {}
        noted = s.noted if x in s.noted else swap(s.noted, None, x)
        return {"noted": noted, "operators": self._ops(s, claim=x), "sweepers": self._sweeps(s, claim=x)}

    # Nodes: out of sight the containers go on, and the API server forgets their pods

    def _nodes(self, s: State) -> Iterator[Move]:
        if s.vanishings:
            for h in set(range(len(self.names))) - {*s.away}:
                left = s.vanishings - 1
                yield move(s, f"node of h{h} vanishes", False, vanishings=left, away=swap(s.away, None, h))
        for h in s.away:
            yield move(s, f"node of h{h} returns", False, away=swap(s.away, h))
            for pod in sorted({pod for pod in s.pods if pod[0] == h and pod[2] in {RUNNING, TERMINATING}}):
                unlisted = s.unlisted if pod[:2] in s.unlisted else swap(s.unlisted, None, pod[:2])
                yield move(s, f"{pod} removed unseen", False, pods=swap(s.pods, pod), unlisted=unlisted)
        for one in s.unlisted:
            if one[0] not in s.away:
                yield move(s, f"kubelet ends {one}", True, unlisted=swap(s.unlisted, one))
            elif s.claims[one[1]] == (one[0], PARKED):
                # Somebody has walked to the robot: an admin who is wrong has lifted the lock.
                x, changed = one[1], {"unlisted": swap(s.unlisted, one)}
                changed["confirmed"] = s.confirmed if x in s.confirmed else swap(s.confirmed, None, x)
                yield move(s, f"admin ends {one} and says so", False, sweepers=self._sweeps(s, claim=x), **changed)

    # Deployment and ReplicaSet controllers: read now, write any time later

    def _manager(self, s: State) -> Iterator[Move]:
        if s.manager:
            yield move(s, "manager dies", False, manager=None)
            kind, h, x, phase = s.manager
            if kind == "set":
                yield move(s, f"RS h{h} id{x}", True, manager=None, sets=put(s.sets, h * self.ids + x, 1))
            elif len(s.pods) >= self.pods:
                yield move(s, "pod quota", True, manager=None)
            else:
                yield move(s, f"pod h{h} id{x}", True, manager=None, pods=swap(s.pods, None, (h, x, phase)))
        for found in s.deployments:
            if found and found[1] != NONE and found[2] and s.sets[found[0] * self.ids + found[1]] != 1:
                h, x, _ = found
                if not self.lag:
                    yield move(s, f"RS h{h} id{x}", True, sets=put(s.sets, h * self.ids + x, 1))
                elif not s.manager:
                    yield move(s, f"manager reads Deployment h{h} id{x}", True, manager=("set", h, x, ""))

    def _sets(self, s: State) -> Iterator[Move]:
        for index, state in enumerate(s.sets):
            h, x = divmod(index, self.ids)
            found = s.deployments[self.names[h]]
            up = [pod for pod in s.pods if pod[:2] == (h, x) and pod[2] != TERMINATING]
            if state and found is None:
                yield move(s, f"garbage RS h{h} id{x}", True, sets=put(s.sets, index, 0))
            elif state == 1 and found != (h, x, 1):
                left = 2 if self.history else 0
                yield move(s, f"RS h{h} id{x} down", True, sets=put(s.sets, index, left))
            if state == 1 and not up:
                phase = CHECKED if self.cached_check and self._allowed(s, h, x) else PENDING
                if self.lag and not s.manager:
                    yield move(s, f"manager reads RS h{h} id{x}", True, manager=("pod", h, x, phase))
                elif not self.lag and len(s.pods) < self.pods:
                    yield move(s, f"pod h{h} id{x}", True, pods=swap(s.pods, None, (h, x, phase)))
            if up and (state != 1 or len(up) > 1):
                for pod in sorted(set(up)):
                    ending = (h, x, TERMINATING) if pod[2] == RUNNING else None
                    yield move(s, f"RS ends {pod}", True, pods=swap(s.pods, pod, ending))

    # What must never and what must always be possible

    def broken(self, s: State) -> str:
        seen: dict[int, int] = {}
        for h, x, phase in (*s.pods, *((h, x, RUNNING) for h, x in s.unlisted)):
            if phase in {RUNNING, TERMINATING}:
                if seen.setdefault(x, h) != h:
                    return f"DOUBLE: h{seen[x]} and h{h} both run on id{x}"
                claim = s.claims[x]
                if self.only != "DOUBLE" and (claim is None or claim[0] != h):
                    return f"LOST: h{h} runs on id{x} without a claim"
        if self.no_duplicates and all(s.claims):
            return "DUP: one instance, two claims"
        return ""

    def settled(self, s: State) -> bool:
        unserved = {h for h in range(len(self.names)) if self._orphan_without_claim(s, h)}
        busy = s.manager or any(op != IDLE for op in s.operators) or any(w != RESTING for w in s.sweepers)
        if busy or (TO_COME in s.apps and s.apps[0] != LIVE):
            return False
        if any(p[2] != RUNNING and not (p[2] == PENDING and p[0] in unserved) for p in s.pods):
            return False
        return all(self._at_rest(s, h) for h in range(len(self.names)) if h not in unserved)

    def _orphan_without_claim(self, s: State, h: int) -> bool:
        """Pods of an orphaned Deployment made while none lived, the id being free by then: they wait, as they should."""
        return self._state(s, h) == ORPHANED and not self._own(s, h)

    def _at_rest(self, s: State, h: int) -> bool:
        """Exactly what the Deployment says: one claim, one pod; without an id only if every id is another's.

        Beside it there may be claims that are parked with reason.
        """
        found, state = self._deployment(s, h), self._state(s, h)
        own = [(x, phase) for x, phase in self._own(s, h) if not self._rightly_parked(s, h, x)]
        named = [found[1]] if found and found[1] != NONE and found[2] else []
        running = [pod[1] for pod in s.pods if pod[0] == h]
        if any(phase for _, phase in own) or [x for x, _ in own] != named or running != named:
            return False
        want = s.wants[h]
        if state == LIVE and want != NONE:
            acceptable = [x for x in range(self.ids) if want in {AUTO, x}]
            served = bool(named) and want in {AUTO, named[0]}
            return served or not any(s.claims[x] is None or s.claims[x] == (h, 0) for x in acceptable)
        return state == ORPHANED or not named
