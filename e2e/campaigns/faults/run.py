"""What one run is made of, and what a fault can see and do while it lasts."""

import asyncio
import random
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from tests.support.proxy import FaultProxy

from campaigns.faults.crew import Crew, Member
from campaigns.faults.observer import Observer
from campaigns.speed.contestants import OURS
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import LEASES
from robotapp_client.transport.errors import ClientError, NotFound
from robotapp_testbed import ControlPlane

REST_LOOK_S = 0.5


@dataclass(frozen=True, slots=True)
class Plan:
    """What one run is made of. `room` is the part of the pods that there is a place for."""

    fault: str
    pods: int
    seed: int
    room: float = 1.1
    schedulers: int = 1
    through_proxy: bool = False
    election: Mapping[str, str] = field(
        default_factory=lambda: {"leaseDuration": "15s", "renewDeadline": "10s", "retryPeriod": "2s"}
    )
    environment: Mapping[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class Run:
    """One run while it lasts: what faults act on."""

    plan: Plan
    cp: ControlPlane
    client: ApiClient
    proxy: FaultProxy
    observer: Observer
    crew: Crew
    random: random.Random
    started_s: float = 0.0
    over_s: float = 0.0
    """When the last fault was over."""
    notes: dict[str, float] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    async def bound(self, part: float, *, within_s: float = 300.0) -> None:
        """Wait until this part of the pods was bound, or until every pod is at rest: what is left over on each node
        may be too little for a pod that the sum has room for."""
        wanted = int(part * self.plan.pods * min(1.0, self.plan.room))
        deadline_s = time.monotonic() + within_s
        look_s = 0.0
        while self.observer.history.binds < wanted:
            now_s = time.monotonic()
            if now_s >= look_s:
                look_s = now_s + REST_LOOK_S
                if self.observer.history.binds and not self.observer.history.unsettled():
                    return
            if now_s > deadline_s:
                raise TimeoutError(f"{self.observer.history.binds} of {wanted} binds after {within_s:.0f} s")
            await asyncio.sleep(0.02)

    async def holder(self) -> str:
        try:
            lease = await self.client.get(LEASES, OURS.lease, namespace=OURS.lease_namespace)
        except (NotFound, ClientError):
            return ""
        return str(lease["spec"].get("holderIdentity") or "")

    async def leader(self, *, other_than: str = "", within_s: float = 90.0) -> Member:
        """The member that holds the lease."""
        deadline_s = time.monotonic() + within_s
        while True:
            holder = await self.holder()
            for member in self.crew.members:
                if member.process.name == holder != other_than and member.process.running:
                    return member
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"nobody else took the lease in {within_s:.0f} s, the holder is {holder!r}")
            await asyncio.sleep(0.1)

    def ended(self) -> None:
        """A fault is over: recovery is counted from here."""
        self.over_s = time.monotonic()
