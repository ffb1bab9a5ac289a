"""Model of devices as ResourceClaims: two schedulers, the resource claim controller, a kubelet and the driver with its lock.

DOUBLE a device in containers of two claims; SAME in two containers of one claim of ours, unless a pod was deleted by force; LOST a container whose claim does not have its device;
RIVAL a device goes to another app between two pods of an app that has wanted it all the time.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from campaigns.claims.model.domain_basis import put
from campaigns.claims.model.explore import Move
from campaigns.claims.model.ledger_rules import LedgerRules

NONE: Final = -1
"""No device, no app."""
IDLE: Final[tuple[Any, ...]] = ("idle", NONE, NONE)
LIVE, SUSPENDED, DELETED = "LSG"
ABSENT, PENDING, BOUND, TERMINATING, FORCED, GONE = "NPBTFG"
"""Phases of a pod. FORCED: its object was deleted by force, and the node has not is_last it."""
EXISTS: Final = frozenset({PENDING, BOUND, TERMINATING})
OURS, THEIRS = "ours", "kube-scheduler"

Claim = tuple[int, tuple[int, ...], bool]
"""Allocated device, pods that are consumers, whether the app is one."""
EMPTY: Final[Claim] = (NONE, (), False)


class Pod(NamedTuple):
    phase: str = ABSENT
    device: int = NONE
    """In its container, which runs."""
    refused: bool = False
    """The driver has refused its claim for 30 s."""


class State(NamedTuple):
    apps: tuple[str, ...]
    claims: tuple[Claim | None, ...]
    """Per app."""
    pods: tuple[Pod, ...]
    locks: tuple[tuple[int, bool] | None, ...]
    """Per device, on the driver's disk: the app whose claim had it last, and whether it is prepared for it."""
    calls: tuple[tuple[Any, ...], ...]
    """Preparations under way: (step, pod, device)."""
    schedulers: tuple[tuple[Any, ...], ...]
    """(step, pod or app, device)."""
    owners: tuple[int, ...]
    """Per device: the app of ours that ran with it last and has wanted it ever since."""


@dataclass
class LedgerModel:
    """holders: the app of each pod slot; app n's pods are placed by kube-scheduler where n is in `theirs`."""

    holders: tuple[int, ...] = (0, 0, 1)
    theirs: tuple[int, ...] = ()
    devices: int = 1
    schedulers: tuple[str, ...] = (OURS, OURS)
    calls: int = 1
    forces: bool = False
    """Pods may be deleted by force while their containers run."""
    stops: bool = True
    """Apps may be suspended and deleted."""
    rules: LedgerRules = field(default_factory=LedgerRules)

    def start(self) -> State:
        apps = max(self.holders) + 1
        return State(
            (LIVE,) * apps,
            (EMPTY,) * apps,
            (Pod(),) * len(self.holders),
            (None,) * self.devices,
            (IDLE,) * self.calls,
            (IDLE,) * len(self.schedulers),
            (NONE,) * self.devices,
        )

    def moves(self, s: State) -> Iterator[Move]:
        yield from self._people(s)
        yield from self._controllers(s)
        yield from self._pods(s)
        for k, call in enumerate(s.calls):
            if not k or call != s.calls[k - 1]:
                yield from self._call(s, k, call)
        is_alike = len(set(self.schedulers)) == 1
        for k, scheduler in enumerate(s.schedulers):
            if not (is_alike and k) or scheduler != s.schedulers[k - 1]:
                yield from self._scheduler(s, k, scheduler)

    # Who notices a change: a conditional write is refused when its object has changed

    def _after(self, s: State, *, k: int = NONE, to: tuple[Any, ...] = IDLE, claim: int = NONE, pod: int = NONE) -> Any:
        """The schedulers after a write to this claim or pod; scheduler k goes on with `to`."""

        def judge(j: int, one: tuple[Any, ...]) -> tuple[Any, ...]:
            if j == k or one == IDLE:
                return to if j == k else one
            by_app = one[0] in {"app", "pods", "empty"}
            is_unread = one[0] in {"bind", "evict"} or (
                one[0] == "pods" and self.rules.release_order == "app, claim, pods"
            )
            stale_claim = self.rules.compares and not is_unread and claim != NONE
            is_concerned = one[1] == claim if by_app else self.holders[one[1]] == claim
            return IDLE if (stale_claim and is_concerned) or (not by_app and one[1] == pod) else one

        return self._sorted(tuple(judge(j, one) for j, one in enumerate(s.schedulers)))

    def _write(
        self, s: State, label: str, progress: bool, h: int, value: Claim | None, *, k: int = NONE, to: Any = IDLE
    ) -> Move:
        return move(s, label, progress, claims=put(s.claims, h, value), schedulers=self._after(s, k=k, to=to, claim=h))

    def _set_pod(self, s: State, label: str, progress: bool, i: int, value: Pod, **changed: Any) -> Move:
        return move(s, label, progress, pods=put(s.pods, i, value), schedulers=self._after(s, pod=i), **changed)

    # People and controllers

    def _people(self, s: State) -> Iterator[Move]:
        for h, state in enumerate(s.apps if self.stops else ()):
            owners = tuple(NONE if owner == h else owner for owner in s.owners)
            if state == LIVE:
                yield move(s, f"app{h} suspended", False, apps=put(s.apps, h, SUSPENDED), owners=owners)
            elif state == SUSPENDED:
                yield move(s, f"app{h} resumed", False, apps=put(s.apps, h, LIVE))
            if state != DELETED:
                yield move(s, f"app{h} deleted", False, apps=put(s.apps, h, DELETED), owners=owners)

    def _controllers(self, s: State) -> Iterator[Move]:
        for h, claim in enumerate(s.claims):
            if claim is None:
                continue
            if s.apps[h] == DELETED:
                yield self._write(s, f"claim{h} collected", True, h, None)
            device, pods, is_standing = claim
            for i in pods:
                if s.pods[i].phase not in EXISTS:
                    rest = tuple(j for j in pods if j != i)
                    is_last = not rest and not is_standing and self._has_finalizer(h)
                    value = EMPTY if is_last else (device, rest, is_standing)
                    yield self._write(s, f"controller takes p{i} off claim{h}", True, h, value)

    def _has_finalizer(self, h: int) -> bool:
        """Only a claim with kube-scheduler's finalizer is emptied by the controller when its last pod has gone."""
        return h in self.theirs or not self.rules.stands

    # Pods and their containers

    def _pods(self, s: State) -> Iterator[Move]:
        for i, pod in enumerate(s.pods):
            h = self.holders[i]
            is_live = s.apps[h] == LIVE
            peers = [j for j in range(len(s.pods)) if j != i and self.holders[j] == h]
            surplus = any(s.pods[j].phase in {PENDING, BOUND} for j in peers)
            if pod.phase == ABSENT:
                if is_live and not any(j < i and s.pods[j].phase == ABSENT for j in peers):
                    yield self._set_pod(s, f"new p{i}", not surplus, i, Pod(PENDING))
            elif pod.phase == PENDING:
                yield self._set_pod(s, f"delete pending p{i}", not is_live or surplus, i, Pod(GONE))
            elif pod.phase == BOUND:
                yield self._set_pod(s, f"delete p{i}", not is_live or surplus, i, pod._replace(phase=TERMINATING))
                if self.forces:
                    yield self._set_pod(s, f"delete p{i} by force", False, i, pod._replace(phase=FORCED))
            elif pod.phase == GONE:
                if not self._is_named(s, i):
                    yield move(s, f"slot {i} free", True, pods=put(s.pods, i, Pod()))
            else:
                yield from self._end(s, i, pod)

    def _is_named(self, s: State, i: int) -> bool:
        if any(claim and i in claim[1] for claim in s.claims) or any(call[1] == i for call in s.calls):
            return True
        return any(one[0] in {"allocate", "reserve", "bind", "evict"} and one[1] == i for one in s.schedulers)

    def _end(self, s: State, i: int, pod: Pod) -> Iterator[Move]:
        """The kubelet stops the container, has the driver unprepare, and then lets the object go."""
        h = self.holders[i]
        if pod.device != NONE:
            yield self._set_pod(s, f"container of p{i} stops", True, i, pod._replace(device=NONE))
        elif not any(call[1] == i for call in s.calls):
            prepared_devices = [x for x, lock in enumerate(s.locks) if lock == (h, True)]
            if prepared_devices and not self._is_used(s, h, i):
                locks = put(s.locks, prepared_devices[0], (h, False))
                yield move(s, f"d{prepared_devices[0]} unprepared for claim{h}", True, locks=locks)
            else:
                yield self._set_pod(s, f"p{i} gone", True, i, Pod(GONE, NONE, pod.refused))

    def _is_used(self, s: State, h: int, i: int) -> bool:
        """Returns whether another pod of the claim has its device on the node, or is about to."""
        return any(
            self.holders[j] == h and (pod.device != NONE or any(call[1] == j for call in s.calls))
            for j, pod in enumerate(s.pods)
            if j != i
        )

    # Kubelet and driver

    def _call(self, s: State, k: int, call: tuple[Any, ...]) -> Iterator[Move]:
        step, i, x = call
        if call == IDLE:
            for j, pod in enumerate(s.pods):
                claim = s.claims[self.holders[j]]
                is_waiting = pod.phase == BOUND and pod.device == NONE and all(other[1] != j for other in s.calls)
                if is_waiting and claim and claim[0] != NONE and j in claim[1]:
                    yield self._to(s, k, ("read", j, claim[0]), f"claim of p{j} read", True)
            return
        yield self._to(s, k, IDLE, "driver or kubelet dies", False)
        if step == "read":
            yield from self._judge_lock(s, k, i, x)
        elif step == "take":
            yield from self._lock(s, k, i, x)
        elif s.pods[i].phase != BOUND:
            yield self._to(s, k, IDLE, f"p{i} is not started any more", True)
        else:
            yield from self._run(s, k, i, x)

    def _judge_lock(self, s: State, k: int, i: int, x: int) -> Iterator[Move]:
        h, lock = self.holders[i], s.locks[x]
        if lock is None or lock[0] == h:
            yield from self._lock(s, k, i, x)
            return
        holder = s.claims[lock[0]]
        if self.rules.grants(lock[1], holder is not None and holder[0] == x):
            yield self._to(s, k, ("take", i, x), f"claim{lock[0]} does not have d{x}", True)
        else:
            pods = put(s.pods, i, s.pods[i]._replace(refused=True))
            yield move(s, f"p{i} refused: claim{lock[0]} has d{x}", True, pods=pods, calls=self._calls(s, k, IDLE))

    def _lock(self, s: State, k: int, i: int, x: int) -> Iterator[Move]:
        """Preparations of one device come one after the other: what another had read about the lock's last claim is read again."""
        h, lock = self.holders[i], s.locks[x]
        if lock is not None and lock[0] != h and not self.rules.grants(lock[1], holder_allocated=False):
            yield self._to(s, k, IDLE, f"d{x} was taken meanwhile", True)
            return
        if self.rules.locks_first:
            locks = put(s.locks, x, (h, True))
            outdated_steps = {"take"} if self.rules.one_at_a_time else set()
            calls = tuple(
                ("read", *call[1:]) if call[0] in outdated_steps and call[2] == x else call for call in s.calls
            )
            calls = tuple(sorted(put(calls, k, ("reply", i, x))))
            yield move(s, f"d{x} locked for claim{h}", True, locks=locks, calls=calls)
        else:
            yield self._to(s, k, ("reply", i, x), f"d{x} prepared for claim{h}, the lock not written", True)

    def _run(self, s: State, k: int, i: int, x: int) -> Iterator[Move]:
        """The kubelet starts the container. Without the lock on the disk the driver may die before it is."""
        h, owner = self.holders[i], s.owners[x]
        is_robbery = owner not in {NONE, h} and s.apps[owner] == LIVE
        label = f"!RIVAL: p{i} gets d{x} of app{owner}" if is_robbery else f"p{i} runs with d{x}"
        owners = put(s.owners, x, NONE if h in self.theirs or s.apps[h] != LIVE else h)
        pods = put(s.pods, i, Pod(BOUND, x))
        calls = self._calls(s, k, IDLE)
        yield move(s, label, True, pods=pods, owners=owners, calls=calls, locks=put(s.locks, x, (h, True)))
        if not self.rules.locks_first:
            yield move(s, f"{label}, the driver dies", False, pods=pods, owners=owners, calls=calls)

    def _calls(self, s: State, k: int, to: tuple[Any, ...]) -> tuple[tuple[Any, ...], ...]:
        return tuple(sorted(put(s.calls, k, to)))

    def _to(self, s: State, k: int, to: tuple[Any, ...], label: str, progress: bool) -> Move:
        return move(s, label, progress, calls=self._calls(s, k, to))

    # Schedulers

    def _scheduler(self, s: State, k: int, one: tuple[Any, ...]) -> Iterator[Move]:
        kind = self.schedulers[k]
        if one == IDLE:
            yield from self._choose(s, k, kind)
            if kind == OURS:
                yield from self._tidy(s, k)
            return
        yield move(s, f"scheduler {k} dies", False, schedulers=self._after(s, k=k))
        step, target, x = one
        if step in {"allocate", "reserve"}:
            yield from self._reserve(s, k, one)
        elif step == "bind":
            pod = Pod(BOUND)
            to = ("allocate" if s.claims[self.holders[target]] == EMPTY else "reserve", target, x)
            after = self._after(s, k=k, to=to if self.rules.binds_first and kind == OURS else IDLE, pod=target)
            yield move(s, f"bind p{target}", True, pods=put(s.pods, target, pod), schedulers=after)
        elif step == "evict":
            pod = s.pods[target]._replace(phase=TERMINATING)
            yield self._set_pod(s, f"refused p{target} deleted", True, target, pod)
        else:
            yield from self._release(s, k, one)

    def _choose(self, s: State, k: int, kind: str) -> Iterator[Move]:
        for i, pod in enumerate(s.pods):
            h = self.holders[i]
            claim = s.claims[h]
            if pod.phase != PENDING or claim is None or (kind == THEIRS) != (h in self.theirs):
                continue
            device, pods, is_standing = claim
            others = tuple(j for j in pods if j != i and s.pods[j].phase in EXISTS)
            if device == NONE:
                steps = [("allocate", i, x) for x in range(self.devices) if self._looks_free(s, x, kind)]
            elif i in pods:
                steps = [("bind", i, device)]
            else:
                is_free = kind == THEIRS or self.rules.may_reserve(others, is_standing, i)
                steps = [("reserve", i, device)] if is_free else []
            for step in steps:
                first = ("bind", i, step[2]) if self.rules.binds_first and kind == OURS else step
                yield self._on(s, k, first, f"{step[0]} d{step[2]} for p{i}")

    def _looks_free(self, s: State, x: int, kind: str) -> bool:
        """Returns whether no claim has the device. Ours also counts pods that use it although their claim is gone."""
        if any(claim and claim[0] == x for claim in s.claims):
            return False
        return kind == THEIRS or all(pod.device != x or pod.phase not in EXISTS for pod in s.pods)

    def _reserve(self, s: State, k: int, one: tuple[Any, ...]) -> Iterator[Move]:
        step, i, x = one
        h = self.holders[i]
        claim = s.claims[h]
        if claim is None:
            yield move(s, "404", True, schedulers=self._after(s, k=k))
            return
        pods, was_standing = claim[1:] if step == "reserve" else ((), False)
        if self.schedulers[k] == OURS:
            users, is_standing = self.rules.list_users(pods, was_standing, i, step != "reserve")
        else:
            users, is_standing = frozenset({*pods, i}), False
        to = IDLE if s.pods[i].phase != PENDING else ("bind", i, x)
        yield self._write(s, f"claim{h} has d{x} for p{i}", True, h, (x, tuple(sorted(users)), is_standing), k=k, to=to)

    def _tidy(self, s: State, k: int) -> Iterator[Move]:
        """Begins to release what an app does not want any more, and to give back what the driver refuses."""
        for h, claim in enumerate(s.claims):
            if claim is not None and claim[0] != NONE and h not in self.theirs:
                yield from self._begin_release(s, k, h, claim)
                refused_pods = [i for i in claim[1] if s.pods[i].refused and s.pods[i].device == NONE]
                if refused_pods and (self.rules.frees_first or not self._has_pods(s, claim)):
                    yield self._on(s, k, ("empty", h, NONE), f"claim{h} to be freed")
        for i, pod in enumerate(s.pods):
            ours = self.holders[i] not in self.theirs
            if pod.phase == BOUND and pod.refused and pod.device == NONE and (ours or self.rules.helps_all):
                yield self._on(s, k, ("evict", i, NONE), f"p{i} to be replaced")

    def _begin_release(self, s: State, k: int, h: int, claim: Claim) -> Iterator[Move]:
        """The claim is read, then its pods: as none of them comes back, and the write is refused when the claim has changed, that is one step."""
        order = self.rules.release_order
        if order == "claim, pods, app":
            if self.rules.may_release(wanted=False, pods_exist=self._has_pods(s, claim)):
                yield self._on(s, k, ("app", h, NONE), f"claim{h} and its pods read")
        elif s.apps[h] != LIVE:
            yield self._on(
                s, k, ("pods", h, NONE), f"app{h} read" if order == "app, claim, pods" else f"claim{h}, app{h} read"
            )

    def _release(self, s: State, k: int, one: tuple[Any, ...]) -> Iterator[Move]:
        """The further reads of a release, and its write."""
        step, h, _ = one
        claim = s.claims[h]
        if claim is None:
            yield self._on(s, k, IDLE, "404")
        elif step == "empty":
            yield self._write(s, f"claim{h} emptied", True, h, EMPTY, k=k)
        else:
            is_unused = claim[0] != NONE and self.rules.may_release(wanted=False, pods_exist=self._has_pods(s, claim))
            is_due = s.apps[h] != LIVE if step == "app" else is_unused
            yield self._on(s, k, ("empty", h, NONE) if is_due else IDLE, f"{step} of claim{h} read")

    @staticmethod
    def _has_pods(s: State, claim: Claim) -> bool:
        return any(s.pods[i].phase in EXISTS for i in claim[1])

    def _on(self, s: State, k: int, to: tuple[Any, ...], label: str) -> Move:
        """Scheduler k goes on with `to`, and nothing is written."""
        return move(s, f"{self.schedulers[k]} {k}: {label}", True, schedulers=self._sorted(put(s.schedulers, k, to)))

    def _sorted(self, schedulers: tuple[tuple[Any, ...], ...]) -> tuple[tuple[Any, ...], ...]:
        """Equal schedulers in one order: which of them does something makes no difference."""
        return tuple(sorted(schedulers)) if len(set(self.schedulers)) == 1 else schedulers

    # What must never and what must always be possible

    def broken(self, s: State) -> str:
        users: dict[int, int] = {}
        for i, pod in enumerate(s.pods):
            if pod.device == NONE:
                continue
            j = users.setdefault(pod.device, i)
            h = self.holders[i]
            if j != i and self.holders[j] != h:
                return f"DOUBLE: p{j} and p{i} both use d{pod.device}"
            if j != i and h not in self.theirs and FORCED not in {pod.phase, s.pods[j].phase}:
                return f"SAME: p{j} and p{i} of claim{h} both use d{pod.device}"
            claim = s.claims[h]
            if pod.phase != FORCED and claim is not None and claim[0] != pod.device:
                return f"LOST: p{i} uses d{pod.device}, its claim has {claim}"
        return ""

    def settled(self, s: State) -> bool:
        if any(one != IDLE for one in (*s.schedulers, *s.calls)):
            return False
        if any(pod.phase in {TERMINATING, FORCED, GONE} for pod in s.pods):
            return False
        has_waiting = False
        for h, state in enumerate(s.apps):
            pods = [pod for i, pod in enumerate(s.pods) if self.holders[i] == h and pod.phase != ABSENT]
            claim = s.claims[h]
            if len(pods) != (state == LIVE) or (state != LIVE and claim is not None and claim[0] != NONE):
                return False
            has_waiting = has_waiting or any(pod.phase == PENDING for pod in pods)
            if any(pod.phase == BOUND and pod.device == NONE for pod in pods):
                return False
        return not has_waiting or {pod.device for pod in s.pods} >= set(range(self.devices))


FIELD: Final = {name: index for index, name in enumerate(State._fields)}


def move(s: State, label: str, progress: bool, /, **changed: Any) -> Move:
    """Returns the move to the state with these fields changed."""
    parts = list(s)
    for name, value in changed.items():
        parts[FIELD[name]] = value
    return label, progress, State._make(parts)
