"""Leader election on a coordination.k8s.io/v1 Lease, with the rules of client-go.

It saves work, nothing more: two leaders for a moment are possible (a paused process wakes up late), so no decision may
depend on being the only one. Clocks of machines are never compared: a lease counts as abandoned when *we* have watched
it unchanged for its whole duration.

Two clocks of this machine count. Our own leadership runs out by boot time, which goes on while the machine is suspended: a
laptop that wakes up after an hour does not lead for another ten seconds beside its successor. Another's lease is watched
by the client's clock, which stands still meanwhile: a process that slept has watched nothing.
"""

import asyncio
import logging
import secrets
import socket
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from robotapp_client.api.client import ApiClient, Json
from robotapp_client.api.resources import LEASES
from robotapp_client.api.times import Now, micro_time, utc_now
from robotapp_client.transport.errors import AlreadyExists, ClientError, Conflict, NotFound, describe

log = logging.getLogger(__name__)

LEASE_DURATION_S: Final = 15.0
RENEW_DEADLINE_S: Final = 10.0
RETRY_PERIOD_S: Final = 2.0
RELEASE_TIMEOUT_S: Final = 3.0
JITTER: Final = 0.2


def boot_time() -> float:
    """Seconds since this machine started, with those it was suspended; where the system has no such clock, the monotonic one."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


def candidate_identity(environ: Mapping[str, str]) -> str:
    """Who we are to a Lease: the pod's name (POD_NAME), else this host and a random part.

    A container that is started again in its pod is the same candidate and leads at once, instead of waiting until the
    Lease of its dead predecessor runs out; no two live containers of one Deployment share a pod's name.
    """
    return environ.get("POD_NAME") or f"{socket.gethostname()}-{secrets.token_hex(4)}"


class LeaderElection:
    """One candidate. `run` returns when leadership is lost; then the process should exit and be started afresh.

    `clock` counts what is left of our own leadership, in seconds.
    """

    def __init__(
        self,
        client: ApiClient,
        namespace: str,
        name: str,
        identity: str,
        *,
        lease_duration_s: float = LEASE_DURATION_S,
        renew_deadline_s: float = RENEW_DEADLINE_S,
        retry_period_s: float = RETRY_PERIOD_S,
        now: Now = utc_now,
        clock: Callable[[], float] = boot_time,
    ) -> None:
        if not lease_duration_s > renew_deadline_s > retry_period_s * (1 + JITTER) > 0:
            raise ValueError("a lease needs duration > renew deadline > 1.2 x retry period > 0")
        if not identity:
            raise ValueError(
                "the identity of a candidate is empty, which in a Lease means that it has no holder; pass a name"
            )
        self._client = client
        self._namespace = namespace
        self._name = name
        self._identity = identity
        self._duration_s = lease_duration_s
        self._deadline_s = renew_deadline_s
        self._period_s = retry_period_s
        self._now = now
        self._clock = clock
        self._lease: Json | None = None  # as last read or written; None: read before the next attempt
        self._observed: tuple[Any, ...] = ()
        self._observed_at = float("-inf")
        self._renewed_at = float("-inf")

    def __repr__(self) -> str:
        role = "leader" if self.is_leader else f"waiting for {self.holder or 'the lease'}"
        return f"<LeaderElection {self._namespace}/{self._name} as {self._identity}: {role}>"

    @property
    def holder(self) -> str:
        """Identity of the holder when last seen; empty without one."""
        return str(self._spec.get("holderIdentity") or "")

    @property
    def is_leader(self) -> bool:
        """Whether our last renewal is still within the deadline: false in a process, or on a machine, that slept too long."""
        return self._clock() - self._renewed_at < self._deadline_s

    async def run(self, on_started: Callable[[], None], on_lost: Callable[[], None]) -> None:
        """Wait for the lease, call `on_started`, renew until it is lost, call `on_lost`, return.

        Cancelling a leader gives the lease back at once (without `on_lost`): stop the work first, then cancel.
        """
        while not await self._attempt():
            await self._pause()
        log.info("%s: leading", self)
        try:
            on_started()
            while self.is_leader:
                await self._pause()
                await self._renew()
        except BaseException:
            await self._release()
            raise
        log.error("%s: lost the lease", self)
        on_lost()

    async def _pause(self) -> None:
        await self._client.sleep(self._period_s * (1 + JITTER * self._client.uniform()))

    async def _renew(self) -> None:
        """One attempt, given up at the deadline: an answer that comes later is worth nothing."""
        remaining_s = self._renewed_at + self._deadline_s - self._clock()
        if remaining_s <= 0:
            return
        try:
            async with asyncio.timeout(remaining_s):
                renewed = await self._attempt()
        except TimeoutError:
            self._lease = None
            return
        if not renewed and self.holder not in ("", self._identity):
            self._renewed_at = float("-inf")  # another process took it: no use in waiting for the deadline

    async def _attempt(self) -> bool:
        """Take or renew the lease if it is free, ours or abandoned. False is a normal outcome."""
        started = self._clock()
        try:
            if self._lease is None or self.holder != self._identity:
                self._observe(await self._client.get(LEASES, self._name, namespace=self._namespace))
            if not self._may_take():
                return False
            self._observe(await self._client.replace(LEASES, self._taken()))
        except NotFound:
            return await self._create(started)
        except Conflict:
            self._lease = None
            return False
        except ClientError as error:
            # A write without an answer may have been applied: the next attempt reads first.
            self._lease = None
            log.warning("%s: %s", self, error, extra={"fields": describe(error)})
            return False
        self._renewed_at = started
        return True

    async def _create(self, started: float) -> bool:
        self._lease = None
        lease = {"metadata": {"name": self._name, "namespace": self._namespace}, "spec": self._claim(transitions=0)}
        try:
            self._observe(await self._client.create(LEASES, lease))
        except AlreadyExists:
            return False
        except ClientError as error:
            log.warning("%s: %s", self, error, extra={"fields": describe(error)})
            return False
        self._renewed_at = started
        return True

    @property
    def _spec(self) -> Json:
        return (self._lease or {}).get("spec") or {}

    def _observe(self, lease: Json) -> None:
        self._lease = lease
        spec = self._spec
        seen = (spec.get("holderIdentity"), spec.get("renewTime"), spec.get("leaseTransitions"))
        if seen != self._observed:
            self._observed = seen
            self._observed_at = self._client.clock()

    def _may_take(self) -> bool:
        if self.holder in ("", self._identity):
            return True
        valid_s = float(self._spec.get("leaseDurationSeconds") or self._duration_s)
        return self._client.clock() - self._observed_at >= valid_s

    def _claim(self, *, transitions: int) -> Json:
        now = micro_time(self._now())
        return {
            "holderIdentity": self._identity,
            "leaseDurationSeconds": max(1, round(self._duration_s)),
            "acquireTime": now,
            "renewTime": now,
            "leaseTransitions": transitions,
        }

    def _taken(self) -> Json:
        """The lease as read, with us as its holder; its resourceVersion makes the write a compare-and-swap."""
        old = self._spec
        same = self.holder == self._identity
        spec = old | self._claim(transitions=int(old.get("leaseTransitions") or 0) + (0 if same else 1))
        if same:
            spec["acquireTime"] = old.get("acquireTime") or spec["acquireTime"]
        return {**(self._lease or {}), "spec": spec}

    async def _release(self) -> None:
        """Give the lease back so that the next one need not wait out its duration. Failing is no harm."""
        if not self.is_leader:
            return
        self._renewed_at = float("-inf")
        try:
            async with asyncio.timeout(RELEASE_TIMEOUT_S):
                # Read first: a renewal may have been cut off by the very cancellation that brings us here.
                self._observe(await self._client.get(LEASES, self._name, namespace=self._namespace))
                if self.holder == self._identity:
                    spec = {key: value for key, value in self._spec.items() if key != "holderIdentity"}
                    spec |= {"leaseDurationSeconds": 1, "renewTime": micro_time(self._now())}
                    self._observe(await self._client.replace(LEASES, {**(self._lease or {}), "spec": spec}))
        except (ClientError, TimeoutError) as error:
            log.info("%s: not released: %s", self, error)
