"""Model of device claims with hand-over: two schedulers, sweepers, pods that die, successors, a rival app.

DOUBLE two live pods with one device; LOST a live pod whose device's claim is missing or another's;
FORGED a claim made or taken for a pod that only says whose it is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

from campaigns.claims.model.device_rules import ALONE, ELSEWHERE, FREE, OWNED, DeviceRules
from campaigns.claims.model.domain_basis import put
from campaigns.claims.model.explore import Move
from robotapp_claims.rules.device import Take
from robotapp_claims.rules.release import Release

IDLE: tuple[Any, ...] = ("idle", -1, -1)
RESTING: tuple[Any, ...] = (-1, 0, 0, 0)
FORGER = -2
"""The pod of an attacker in a claim."""
LIVE, SUSPENDED, DELETED = "LSG"
ABSENT, PENDING, RUNNING, TERMINATING, GONE = "NPRTG"


class State(NamedTuple):
    apps: tuple[str, ...]
    claims: tuple[tuple[int, int] | None, ...]
    """Per device: (holder, pod or FREE)."""
    pods: tuple[tuple[str, int], ...]
    """Per slot: (phase, granted device)."""
    schedulers: tuple[tuple[Any, ...], ...]
    """(step, pod, device)."""
    sweepers: tuple[tuple[Any, ...], ...]
    """(device, stage, holder, pod)."""
    forged: tuple[tuple[int, str], ...] = ()
    """(holder it imitates, how): look-alikes that another scheduler has bound, and that the attacker never takes away."""


FIELD = {name: index for index, name in enumerate(State._fields)}


@dataclass
class DeviceModel:
    """holders: the holder (app instance) of each pod slot. groups: holders of one group differ in instance only."""

    holders: tuple[int, ...] = (0, 0, 1)
    groups: tuple[int, ...] = (0, 1)
    devices: int = 1
    schedulers: int = 2
    sweepers: int = 2
    unreserve: bool = False
    """Structure mutant: the scheduler deletes its claim when the binding got no answer."""
    gives_back: bool = False
    """A scheduler may take the device from a pod that waits for the rest of its devices (F4): fence, then delete."""
    fences: bool = True
    """False is a structure mutant: deleted without the fence."""
    forgeries: int = 0
    """Look-alikes the attacker may have bound; those for our scheduler need no bound, because none may ever have an effect."""
    rules: DeviceRules = field(default_factory=DeviceRules)

    def __post_init__(self) -> None:
        self.precondition = self.rules.precondition()
        self.compares = self.rules.compares()

    def start(self) -> State:
        return State(
            (LIVE,) * (max(self.holders) + 1),
            (None,) * self.devices,
            ((ABSENT, FREE),) * len(self.holders),
            (IDLE,) * self.schedulers,
            (RESTING,) * self.sweepers,
        )

    def moves(self, s: State) -> Iterator[Move]:
        yield from self._people(s)
        yield from self._attacker(s)
        yield from self._pods(s)
        for k, scheduler in enumerate(s.schedulers):
            if not k or scheduler != s.schedulers[k - 1]:
                yield from self._scheduler(s, k, scheduler)
        for k, sweeper in enumerate(s.sweepers):
            if not k or sweeper != s.sweepers[k - 1]:
                yield from self._sweeper(s, k, sweeper)

    # Who falls back to idle when an object changes

    def _scheds(
        self, s: State, k: int = -1, to: tuple[Any, ...] = IDLE, *, claim: int = -1, pod: int = -1
    ) -> tuple[tuple[Any, ...], ...]:
        def after(j: int, one: tuple[Any, ...]) -> tuple[Any, ...]:
            if j == k or one == IDLE:
                return to if j == k else one
            compared = {"adopt", "take", "fence", "give back"} if self.compares else set()
            stale = one[1] == pod or (one[2] == claim and one[0] in compared)
            return IDLE if stale else one

        return tuple(sorted(after(j, one) for j, one in enumerate(s.schedulers)))

    def _sweeps(
        self, s: State, k: int = -1, to: tuple[Any, ...] = RESTING, *, claim: int = -1, gone: bool = False
    ) -> tuple[tuple[Any, ...], ...]:
        refused = self.precondition == "rv" or (self.precondition == "uid" and gone)

        def after(j: int, one: tuple[Any, ...]) -> tuple[Any, ...]:
            if j == k:
                return to
            return RESTING if refused and one[0] == claim else one

        return tuple(sorted(after(j, one) for j, one in enumerate(s.sweepers)))

    def _set_pod(self, s: State, label: str, progress: bool, i: int, value: tuple[str, int]) -> Move:
        return move(s, label, progress, pods=put(s.pods, i, value), schedulers=self._scheds(s, pod=i))

    def _set_claim(
        self,
        s: State,
        label: str,
        progress: bool,
        x: int,
        value: tuple[int, int] | None,
        *,
        scheduler: tuple[int, tuple[Any, ...]] = (-1, IDLE),
        sweeper: int = -1,
    ) -> Move:
        gone = value is None or s.claims[x] is None
        return move(
            s,
            label,
            progress,
            claims=put(s.claims, x, value),
            schedulers=self._scheds(s, *scheduler, claim=x),
            sweepers=self._sweeps(s, sweeper, claim=x, gone=gone),
        )

    # People, controllers, kubelets

    def _people(self, s: State) -> Iterator[Move]:
        for h, state in enumerate(s.apps):
            if state == LIVE:
                yield move(s, f"h{h} suspended", False, apps=put(s.apps, h, SUSPENDED))
            elif state == SUSPENDED:
                yield move(s, f"h{h} resumed", False, apps=put(s.apps, h, LIVE))
            if state != DELETED:
                yield move(s, f"h{h} deleted", False, apps=put(s.apps, h, DELETED))

    def _attacker(self, s: State) -> Iterator[Move]:
        """Pods with the labels of any holder. One of the holder's own namespace that lives is no look-alike, but may get nothing new."""
        if not self.forgeries:
            return
        for h, how in product(range(len(s.apps)), (ELSEWHERE, OWNED, ALONE)):
            if how != ALONE and (h, how) not in s.forged and len(s.forged) < self.forgeries:
                forged = tuple(sorted((*s.forged, (h, how))))
                yield move(s, f"look-alike of h{h} ({how}) runs", False, forged=forged)
            for x, claim in enumerate(s.claims):
                held = None if claim is None else self._who(claim[0])
                take = self.rules.forged_take(held, FREE if claim is None else claim[1], self._who(h), how)
                if take is not Take.BUSY:
                    label = f"!FORGED: look-alike of h{h} ({how}) may {take.lower()} d{x}"
                    yield move(s, label, False, claims=put(s.claims, x, (h, FORGER)))

    def _pods(self, s: State) -> Iterator[Move]:
        referred = {claim[1] for claim in s.claims if claim} | {one[1] for one in s.schedulers if one != IDLE}
        for i, (phase, device) in enumerate(s.pods):
            h = self.holders[i]
            live = s.apps[h] == LIVE
            peers = [j for j in range(len(s.pods)) if j != i and self.holders[j] == h]
            surplus = any(s.pods[j][0] in {PENDING, RUNNING} for j in peers)
            if phase == ABSENT:
                if live and not any(j < i and s.pods[j][0] == ABSENT for j in peers):
                    yield self._set_pod(s, f"new p{i}", not surplus, i, (PENDING, FREE))
            elif phase == PENDING:
                yield self._set_pod(s, f"delete pending p{i}", not live or surplus, i, (GONE, FREE))
            elif phase == RUNNING:
                yield self._set_pod(s, f"delete p{i}", not live or surplus, i, (TERMINATING, device))
            elif phase == TERMINATING:
                yield self._set_pod(s, f"p{i} ends", True, i, (GONE, FREE))
            elif i not in referred:
                yield move(s, f"slot {i} free", True, pods=put(s.pods, i, (ABSENT, FREE)))

    # Schedulers: create or take over, then bind

    def _scheduler(self, s: State, k: int, one: tuple[Any, ...]) -> Iterator[Move]:
        step, i, x = one
        if one == IDLE:
            for pod, (phase, _) in enumerate(s.pods):
                if phase == PENDING and not self._waits(s, pod):
                    yield from self._choose(s, k, pod)
                    yield from self._give_up(s, k, pod)
            return
        yield move(s, "scheduler dies or gets 5xx", False, schedulers=self._scheds(s, k))
        if step == "create":
            yield from self._create(s, k, i, x)
        elif step in {"adopt", "take"}:
            claim = s.claims[x]
            if claim is None:
                yield move(s, "404", True, schedulers=self._scheds(s, k))
            else:
                value = (claim[0], i)
                yield self._set_claim(s, f"p{i} {step}s d{x}", True, x, value, scheduler=(k, ("bind", i, x)))
        elif step == "bind":
            bound = put(s.pods, i, (RUNNING, x))
            yield move(s, f"bind p{i} with d{x}", True, pods=bound, schedulers=self._scheds(s, k, pod=i))
            if self.unreserve:
                undone = self._scheds(s, k, ("undo", i, x), pod=i)
                yield move(s, f"bind p{i} with d{x}, no answer", False, pods=bound, schedulers=undone)
        elif step == "fence":
            yield move(s, f"p{i} fenced", True, schedulers=self._scheds(s, k, ("give back", i, x), pod=i))
        else:
            label = "Unreserve" if step == "undo" else f"p{i} gives back"
            yield self._set_claim(s, f"{label} d{x}", True, x, None, scheduler=(k, IDLE))

    def _waits(self, s: State, i: int) -> bool:
        """For a predecessor, which a look-alike is taken for."""
        h = self.holders[i]
        return self.rules.waits(self._who(h), tuple(how for who, how in s.forged if who == h))

    def _give_up(self, s: State, k: int, i: int) -> Iterator[Move]:
        """Pod and claim have been read; both writes that follow carry the versions seen here."""
        for x, claim in enumerate(s.claims):
            if self.gives_back and claim == (self.holders[i], i):
                to = ("fence" if self.fences else "give back", i, x)
                yield move(s, f"p{i} cannot have the rest", False, schedulers=self._scheds(s, k, to))

    def _choose(self, s: State, k: int, i: int) -> Iterator[Move]:
        """A device the pod has already comes first; else any that it may take or create."""
        takes = [self._take(s, i, x) for x in range(self.devices)]
        own = [x for x, take in enumerate(takes) if take is Take.ADOPT]
        steps = {Take.CREATE: "create", Take.ADOPT: "adopt", Take.TAKE: "take"}
        for x in own or range(self.devices):
            if takes[x] is not Take.BUSY:
                to = (steps[takes[x]], i, x)
                yield move(s, f"p{i} tries d{x}", True, schedulers=self._scheds(s, k, to))

    def _take(self, s: State, i: int, x: int) -> Take:
        claim, h = s.claims[x], self.holders[i]
        if claim is None:
            return self.rules.take(None, FREE, self._who(h), i)
        return self.rules.take(self._who(claim[0]), claim[1], self._who(h), i)

    def _who(self, h: int) -> tuple[int, int]:
        return (self.groups[h], h)

    def _create(self, s: State, k: int, i: int, x: int) -> Iterator[Move]:
        """The create cannot carry the status: the claim is everybody's of this component until its pod is written."""
        if s.claims[x] is None:
            value = (self.holders[i], FREE)
            yield self._set_claim(s, f"create d{x} for p{i}", True, x, value, scheduler=(k, ("take", i, x)))
            yield self._set_claim(s, f"create d{x} for p{i}, no answer", False, x, value, scheduler=(k, IDLE))
        else:
            yield move(s, "409", True, schedulers=self._scheds(s, k))

    # Sweepers

    def _sweeper(self, s: State, k: int, one: tuple[Any, ...]) -> Iterator[Move]:
        if one == RESTING:
            for x, claim in enumerate(s.claims):
                if claim:
                    yield from self._begin(s, k, x, claim)
            return
        x, stage, h, i = one
        yield move(s, "sweeper dies", False, sweepers=self._sweeps(s, k))
        if stage == 1:
            live = s.apps[h] == LIVE
            decision = self.rules.release(self._use(s, x, h, i), live, handed_over=True)
            stages = {Release.DELETE: 2, Release.DRAIN: 3}
            to = (x, stages[decision], h, i) if decision in stages else RESTING
            yield move(s, f"app of d{x} read", True, sweepers=self._sweeps(s, k, to))
        elif s.claims[x] is None:
            yield move(s, "404", True, sweepers=self._sweeps(s, k))
        elif stage == 2:
            yield self._set_claim(s, f"sweep deletes d{x}", True, x, None, sweeper=k)
        else:
            yield self._set_claim(s, f"sweep drains d{x}", True, x, (h, FREE), sweeper=k)

    def _begin(self, s: State, k: int, x: int, claim: tuple[int, int]) -> Iterator[Move]:
        """The pod is read first; with the answer remembered, the app is read next."""
        h, i = claim
        use = self._use(s, x, h, i)
        # What the app says can only matter where the rule asks for it: both answers leading to KEEP end here.
        answers = {self.rules.release(use, live, handed_over=True) for live in (True, False)}
        if not answers <= {Release.KEEP, Release.WAIT}:
            yield move(s, f"pod of d{x} read: {use}", True, sweepers=self._sweeps(s, k, (x, 1, h, i)))

    def _use(self, s: State, x: int, h: int, i: int) -> str:
        """What the pod named in the claim does; in stage 1 it cannot have come back: GONE is for ever."""
        phase, device = s.pods[i] if i != FREE else (ABSENT, FREE)
        return self.rules.use(self._who(h), i, x, phase, device)

    # What must never and what must always be possible

    def broken(self, s: State) -> str:
        users: dict[int, int] = {}
        for i, (phase, device) in enumerate(s.pods):
            if phase in {RUNNING, TERMINATING}:
                if device in users:
                    return f"DOUBLE: p{users[device]} and p{i} both use d{device}"
                users[device] = i
        for device, i in users.items():
            if s.claims[device] != (self.holders[i], i):
                return f"LOST: p{i} uses d{device}, claimed {s.claims[device]}"
        return ""

    def settled(self, s: State) -> bool:
        if any(one != IDLE for one in s.schedulers) or any(one != RESTING for one in s.sweepers):
            return False
        if any(phase in {TERMINATING, GONE} for phase, _ in s.pods):
            return False
        for h, state in enumerate(s.apps):
            up = [i for i, (phase, _) in enumerate(s.pods) if self.holders[i] == h and phase != ABSENT]
            waits = bool(up) and s.pods[up[0]][0] == PENDING
            if len(up) != (state == LIVE) or (waits and None in s.claims):
                return False
        users = {device: (self.holders[i], i) for i, (phase, device) in enumerate(s.pods) if phase == RUNNING}
        return all(s.claims[x] == users.get(x) for x in range(self.devices))


def move(s: State, label: str, progress: bool, /, **changed: Any) -> Move:
    parts = list(s)
    for name, value in changed.items():
        parts[FIELD[name]] = value
    return label, progress, State._make(parts)
