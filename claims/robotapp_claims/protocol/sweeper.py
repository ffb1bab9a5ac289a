"""The sweep gives claims back. Operator and scheduler both run it; any number of sweepers may run at once.

Level-triggered: a pass reads the state and never the content of an event. Events only make the next pass come sooner.
Time is this process's monotonic clock since it first saw a claim Draining; a restart begins the rest anew.
"""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from typing import Final

import msgspec

from robotapp_claims.protocol.claim_nodes import Whereabouts
from robotapp_claims.protocol.domain_users import used, used_elsewhere
from robotapp_claims.protocol.errors import Troubles
from robotapp_claims.protocol.release import give_back
from robotapp_claims.protocol.repair import repair
from robotapp_claims.protocol.sweep_snapshot import View, read_view, used_on_node
from robotapp_claims.protocol.writes import Api, Refused, delete_claim, drain, park, touch
from robotapp_claims.rules.device import PodUse, pod_use, release_device, wants_devices
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_claims.rules.release import Release, pod_lost, release_domain
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client.api.parallelize import at_once
from robotapp_client.api.times import Now, utc_now
from robotapp_client.transport.errors import ClientError, describe

log = logging.getLogger(__name__)

PERIOD_S: Final = 30.0
HANDOVER_S: Final = 15.0
PENDING_S: Final = 60.0
"""For the scheduler's sweep."""
PAUSE_S: Final = 0.1
"""Least time between passes: a burst of deletions is one pass."""
LIMIT: Final = 8
"""Claims that are looked after side by side: one after the other, a few hundred would take longer than a quarantine."""
DUTY: Final = 4.0
"""A pass is followed by a pause of this many times its length, so that a storm costs a fifth of the time at most.

But for no longer than the period: where the API server is slow, a pass is long for its answers and not for our work, and
a free id would wait for many periods.
"""


class Rests:
    """Since when each Draining claim has been resting: by uid and version, so that a touch starts over."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._since: dict[tuple[str, str], float] = {}
        self._due: list[float] = []

    def __repr__(self) -> str:
        return f"<Rests of {len(self._since)} claims>"

    def start_pass(self, claims: Iterable[Claim]) -> None:
        present = {self._key(claim) for claim in claims}
        self._since = {key: since for key, since in self._since.items() if key in present}
        self._due = []

    def rested(self, claim: Claim, rest_s: float) -> bool:
        """Whether `rest_s` have passed since this sweeper first saw the claim in this version."""
        now = self._clock()
        end = self._since.setdefault(self._key(claim), now) + rest_s
        if end > now:
            self._due.append(end)
        return end <= now

    def next_due_s(self) -> float | None:
        """Seconds until the first rest ends."""
        return min(self._due) - self._clock() if self._due else None

    @staticmethod
    def _key(claim: Claim) -> tuple[str, str]:
        return (claim.metadata.uid, claim.metadata.resource_version)


class Sweeper:
    """Gives back what is not used, and re-creates claims of what runs.

    pending_s: a pod that is not bound gives a device back when its claim was not touched for so long (F4); None: never.
    namespaces: sweep only holders there (a namespaced operator); None sweeps all. Without the right to list workloads
    everywhere such a sweep gives no domain of an app back: apps elsewhere may share it. granted_pods: bare pods with grants,
    from a cache: their claims are repaired, and kept without a request while the cache shows the pod. on_conflicts gets, after each pass, all things with two users. counts: writes and passes by kind.
    now: the wall clock, by which the time of jobs is over.
    limit: claims under way at a time; each is decided on what this pass has read, whatever becomes of the others.
    """

    def __init__(
        self,
        client: Api,
        *,
        period_s: float = PERIOD_S,
        handover_s: float = HANDOVER_S,
        pending_s: float | None = None,
        namespaces: Collection[str] | None = None,
        granted_pods: Callable[[], Iterable[Pod]] = tuple,
        on_conflicts: Callable[[Sequence[ClaimConflict]], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
        now: Now = utc_now,
        limit: int = LIMIT,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self._client = client
        self._period_s = period_s
        self._handover_s = handover_s
        self._pending_s = pending_s
        self._namespaces = namespaces
        self._granted_pods = granted_pods
        self._on_conflicts = on_conflicts or (lambda _: None)
        self._clock = clock
        self._now = now
        self._limit = limit
        self._granted: dict[str, Pod] = {}
        """By uid, as of this pass."""
        self._rests = Rests(clock)
        self._whereabouts = Whereabouts(client, clock, self.counts)
        self._woken = asyncio.Event()

    def __repr__(self) -> str:
        return f"<Sweeper every {self._period_s} s: {dict(self.counts)}>"

    def sweep_soon(self) -> None:
        """Sweep soon: call it when a pod, Deployment, RobotApp or claim was deleted or has ended."""
        self._woken.set()

    async def run(self) -> None:
        """Sweep for ever; failed passes are logged and counted, and the next one starts from nothing."""
        while True:
            started = self._clock()
            self._woken.clear()
            due_s: float | None = None
            try:
                await self.sweep_once()
                due_s = self._rests.next_due_s()
            except (ClientError, msgspec.ValidationError) as error:
                self.counts["failed passes"] += 1
                log.warning("sweep ended early, nothing was concluded from it: %s", describe(error))
            except Exception:  # one odd object must not end the process that sweeps, again after each restart
                self.counts["failed passes"] += 1
                log.exception("sweep ended by a bug, nothing was concluded from it")
            await asyncio.sleep(pause_s(self._clock() - started, period_s=self._period_s))
            wait_s = self._period_s if due_s is None else min(self._period_s, max(due_s, 0))
            try:
                await asyncio.wait_for(self._woken.wait(), max(0, started + wait_s - self._clock()))
            except TimeoutError:
                continue

    async def sweep_once(self) -> None:
        """One pass. Raises what a listing raised; what goes wrong with one claim is counted, and the others go on."""
        view = await read_view(self._client, self._namespaces, now=self._now)
        self._granted = {pod.metadata.uid: pod for pod in self._granted_pods()}
        self._rests.start_pass(view.claims)
        self._whereabouts.start_pass(view.claims)
        troubles = Troubles(self.counts)
        await at_once(partial(self._treat, view, troubles), view.claims, limit=self._limit, error_ends=True)
        conflicts = await repair(view, [*view.pods.values(), *self._granted.values()], self.counts, troubles)
        troubles.log_summary()
        self.counts["passes"] += 1
        self._on_conflicts(conflicts)

    async def _treat(self, view: View, troubles: Troubles, claim: Claim) -> None:
        """Decide about one claim, and do it."""
        with troubles.of(claim.name):
            decision = await self._decide(view, claim)
            await self._act(view, claim, decision)
            if decision is Release.KEEP and claim.standing:
                await self._whereabouts.follow(view, claim)

    async def _decide(self, view: View, claim: Claim) -> Release:
        if not claim.holder.is_app:
            return await self._decide_pod(view, claim)
        return await (self._decide_device(view, claim) if claim.spec.device else self._decide_domain(view, claim))

    async def _decide_domain(self, view: View, claim: Claim) -> Release:
        is_used = await used(view, claim)
        wanted = not is_used and await view.wants(claim)
        if not is_used and not wanted:
            elsewhere = await used_elsewhere(view, claim)
            if elsewhere is None:
                return Release.KEEP  # a sweep of all namespaces (the scheduler's) sees which apps share it
            is_used = elsewhere
        return await self._release(view, claim, wanted=wanted, is_used=is_used)

    async def _release(self, view: View, claim: Claim, *, wanted: bool, is_used: bool) -> Release:
        return release_domain(
            phase=claim.status.phase,
            wanted=wanted,
            used=is_used,
            rested=claim.draining and self._rests.rested(claim, view.rest_s(claim)),
            unseen=not (wanted or is_used) and bool(await view.unseen(claim)),
        )

    async def _decide_device(self, view: View, claim: Claim) -> Release:
        use = pod_use(claim, view.pods.get(claim.status.pod))
        if use is PodUse.USES:
            return self._while_pending(claim, view.pods[claim.status.pod])
        if use is PodUse.GONE and await used_on_node(self._client, claim):
            return Release.KEEP
        app = await view.app(claim.holder)
        wanted = wants_devices(app, claim.holder) and (
            app is not None and await view.instance_exists(app, claim.holder.instance)
        )
        waiting = use is PodUse.NONE
        return release_device(
            use=use, wanted=wanted, handed_over=waiting and self._rests.rested(claim, self._handover_s)
        )

    async def _decide_pod(self, view: View, claim: Claim) -> Release:
        """A cache is good enough to keep what stands, so most claims cost no request; it never decides what is released."""
        cached = self._granted.get(claim.holder.uid)
        if claim.standing and cached is not None and cached.spec.node_name and not pod_lost(cached, claim):
            return Release.KEEP
        pod = await view.holder_pod(claim.holder)
        lost = pod_lost(pod, claim)
        if claim.spec.device:
            return Release.DELETE if lost or pod is None else self._while_pending(claim, pod)
        return await self._release(view, claim, wanted=False, is_used=not lost)

    def _while_pending(self, claim: Claim, pod: Pod) -> Release:
        """Every attempt to place the pod touches its claims, so that only what is not even tried rests here."""
        if self._pending_s is None or pod.spec.node_name or not self._rests.rested(claim, self._pending_s):
            return Release.KEEP
        return Release.GIVE_BACK

    async def _act(self, view: View, claim: Claim, decision: Release) -> None:
        if decision in {Release.KEEP, Release.WAIT}:
            return
        if decision is Release.RESTORE:
            await touch(self._client, claim)
        elif decision is Release.PARK:
            await park(self._client, claim)
        elif decision is Release.DRAIN:
            drained = await drain(self._client, claim)
            self._rests.rested(drained, self._handover_s if claim.spec.device else view.rest_s(claim))
        elif decision is Release.GIVE_BACK:
            pod = view.pods.get(claim.status.pod) or await view.holder_pod(claim.holder)
            if pod is None or not await give_back(self._client, pod, (claim,)):
                raise Refused
        else:
            await delete_claim(self._client, claim)
        self.counts[decision.value] += 1
        log.info("claim %s: %s", claim.name, decision.value)


def pause_s(length_s: float, *, period_s: float) -> float:
    """How long nothing is looked at after a pass of this length, whatever happens."""
    return max(PAUSE_S, min(DUTY * length_s, period_s))
