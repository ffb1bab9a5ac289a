"""What a watch shows of a run: when pods changed, were bound, were refused, and when their Events were written."""

import asyncio
import time
from collections.abc import Callable

import msgspec

from campaigns.rigs.watching import Watching
from campaigns.scheduler.load import SeenMeta
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import EVENTS, PODS
from robotapp_client.informer.reflector import Change, Reflector

Progress = Callable[[int], None]


class SeenSpec(msgspec.Struct, gc=False, rename="camel"):
    node_name: str = ""


class SeenCondition(msgspec.Struct, gc=False, rename="camel"):
    type: str = ""
    status: str = ""


class SeenStatus(msgspec.Struct, gc=False, rename="camel"):
    conditions: list[SeenCondition] = []


class SeenPod(msgspec.Struct, gc=False, rename="camel"):
    metadata: SeenMeta
    spec: SeenSpec
    status: SeenStatus = msgspec.field(default_factory=SeenStatus)

    @property
    def refused(self) -> bool:
        return any(each.type == "PodScheduled" and each.status == "False" for each in self.status.conditions)


class SeenEvent(msgspec.Struct, gc=False, rename="camel"):
    metadata: SeenMeta


class _Watch(Watching):
    """A reflector and something to wait for."""

    def __init__(self) -> None:
        self._changed = asyncio.Event()

    async def _until(
        self,
        number: Callable[[], int],
        wanted: int,
        *,
        timeout_s: float | None = None,
        progress: Progress,
        stall_s: float | None = None,
    ) -> bool:
        """Wait until `number()` reaches `wanted`; False when it does not in time, or stands still for `stall_s`."""
        try:
            async with asyncio.timeout(timeout_s), asyncio.timeout(stall_s) as stall:
                best = 0
                while (count := number()) < wanted:
                    if stall_s is not None and count > best:
                        best = count
                        stall.reschedule(asyncio.get_running_loop().time() + stall_s)
                    self._changed.clear()
                    progress(count)
                    await self._changed.wait()
        except TimeoutError:
            return False
        progress(wanted)
        return True


class PodWatch(_Watch):
    """Pods of a label selector, times in monotonic seconds; `first_change_s`: a scheduler wrote to one of them."""

    def __init__(self, client: ApiClient, namespace: str, selector: str) -> None:
        super().__init__()
        self.bound_s: dict[str, float] = {}
        self.refused: set[str] = set()
        self.first_change_s = 0.0
        self.first_change = asyncio.Event()
        self._reflector = Reflector(
            client, PODS, as_type=SeenPod, namespace=namespace, label_selector=selector, on_change=self._on_change
        )

    def _on_change(self, change: Change) -> None:
        if change.new is None:
            return
        pod, now_s = change.new, time.monotonic()
        if change.kind == "MODIFIED" and not self.first_change_s:
            self.first_change_s = now_s
            self.first_change.set()
        if pod.spec.node_name and pod.metadata.name not in self.bound_s:
            self.bound_s[pod.metadata.name] = now_s
        if pod.refused:
            self.refused.add(pod.metadata.name)
        self._changed.set()

    async def bound(self, wanted: int, *, timeout_s: float, progress: Progress = lambda _: None) -> bool:
        return await self._until(lambda: len(self.bound_s), wanted, timeout_s=timeout_s, progress=progress)

    async def all_refused(self, wanted: int, *, stall_s: float, progress: Progress = lambda _: None) -> bool:
        """As long as it takes: False only when none of them was refused for `stall_s`."""
        return await self._until(lambda: len(self.refused), wanted, stall_s=stall_s, progress=progress)


class EventWatch(_Watch):
    """How many Scheduled Events were written since it began, and when the last one came."""

    def __init__(self, client: ApiClient, namespace: str) -> None:
        super().__init__()
        self.count = 0
        self.last_s = 0.0
        self._reflector = Reflector(
            client,
            EVENTS,
            as_type=SeenEvent,
            namespace=namespace,
            field_selector="reason=Scheduled",
            on_change=self._on_change,
        )

    def _on_change(self, change: Change) -> None:
        if change.kind == "ADDED":
            self.count += 1
            self.last_s = time.monotonic()
            self._changed.set()

    async def written(self, wanted: int, *, timeout_s: float) -> bool:
        return await self._until(lambda: self.count, wanted, timeout_s=timeout_s, progress=lambda _: None)
