"""One contestant, one workload, once: a fresh process drains the pods, then has to answer single ones quickly."""

import asyncio
import contextlib
import itertools
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from campaigns.common.figures import percentile
from campaigns.scheduler import load
from campaigns.speed import contestants
from campaigns.speed.contestants import KUBE_SCHEDULER, Contestant
from campaigns.speed.scenery import NAMESPACE, Scenery, Size, selector
from campaigns.speed.watches import EventWatch, PodWatch
from campaigns.speed.workloads import HIGH, Workload, node, placed, pod
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODES, PODS, SERVICES, Resource
from robotapp_client.transport.errors import NotFound
from robotapp_testbed import ControlPlane
from robotapp_testbed.processes.process import Process, cpu_seconds, rss_bytes


@dataclass(frozen=True, slots=True)
class Usage:
    cpu_s: float
    rss_bytes: int


def family(pid: int) -> list[int]:
    """The process and all its descendants that run now."""
    pids = [pid]
    for one in pids:
        for children in Path(f"/proc/{one}/task").glob("*/children"):
            try:
                pids += map(int, children.read_text().split())
            except OSError:  # a thread that ended meanwhile
                continue
    return pids


def usage(pid: int) -> Usage:
    pids = family(pid)
    return Usage(sum(map(cpu_seconds, pids)), sum(map(rss_bytes, pids)))


PERIOD_S = 0.2
AT_ONCE = 10
"""Running pods that end each period and are there again in the next."""


class Churn:
    """Each period creates a node, a Service and a pod that fits nowhere, and deletes those of the period before."""

    def __init__(self, client: ApiClient, contestant: Contestant, size: Size) -> None:
        self._client = client
        self._contestant = contestant
        self._size = size
        self._ended: list[int] = []
        self._name = "churn-0"

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        task = asyncio.create_task(self._run())
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            await self._go(self._name)
            await self._return()

    async def _run(self) -> None:
        for step in itertools.count():
            self._name = f"churn-{step}"
            await self._come(self._name, step)
            await self._return()
            await asyncio.sleep(PERIOD_S)
            await self._go(self._name)
            await self._end(step)

    async def _go(self, name: str) -> None:
        await asyncio.gather(*(self._delete(kind, name) for kind in (NODES, SERVICES, PODS)))

    async def _come(self, name: str, step: int) -> None:
        extra = node(self._size.nodes + step)
        extra["metadata"]["name"] = name
        service = {"metadata": {"name": name}, "spec": {"selector": {"app": name}, "ports": [{"port": 80}]}}
        large = pod(name, "churn", self._contestant.scheduler_name, {"cpu": "64", "priorityClassName": HIGH})
        await load.ensure(self._client, NODES, extra)
        await load.ensure(self._client, SERVICES, service, namespace=NAMESPACE)
        await load.ensure(self._client, PODS, large, namespace=NAMESPACE)

    async def _end(self, step: int) -> None:
        if self._size.prebound:
            chosen = sorted({(step * AT_ONCE + k) % self._size.prebound for k in range(AT_ONCE)})
            self._ended += chosen
            await asyncio.gather(*(self._delete(PODS, f"placed-{index:06}") for index in chosen))

    async def _return(self) -> None:
        ended, self._ended = self._ended, []
        for index in ended:
            await load.ensure(self._client, PODS, placed(index, self._size.nodes), namespace=NAMESPACE)

    async def _delete(self, resource: Resource, name: str) -> None:
        with contextlib.suppress(NotFound):
            await self._client.delete(resource, name, namespace=NAMESPACE if resource.namespaced else None)


SETTLE_S = 180.0
REST, REST_STEP_S, REST_STEPS = 0.15, 0.5, 3
"""A scheduler that uses less of a core than this in each of so many steps is at rest."""
STARTED_S = 0.05
"""CPU that even the leanest has used when it has read anything."""
REFUSE_S = 60.0
"""A scheduler that has refused none of the waiting pods in this time will not refuse them all; with all of them it may take minutes."""
Figures = dict[str, float]
Go = Callable[[], Awaitable[object]]
Show = Callable[[str, int], Callable[[int], None]]


@dataclass(frozen=True, slots=True)
class Rates:
    """`latency_pods` are created at `latency_rate` per second; 0 leaves that part out."""

    latency_pods: int
    latency_rate: float


@dataclass(frozen=True, slots=True)
class Case:
    """Who has to place how many pods of what."""

    workload: Workload
    contestant: Contestant
    pods: int

    def pod(self, name: str) -> load.Json:
        claims = {"resourceClaims": [{"name": "device", "resourceClaimName": name}]} if self.workload.devices else {}
        return pod(name, "measured", self.contestant.scheduler_name, self.workload.pod | claims)


class Run:
    """What does not change between runs; `measure` is one of them."""

    def __init__(self, cp: ControlPlane, client: ApiClient, scenery: Scenery, size: Size, rates: Rates) -> None:
        self._cp = cp
        self._client = client
        self._scenery = scenery
        self._size = size
        self._rates = rates

    async def measure(self, case: Case, show: Show) -> Figures:
        await self._scenery.mend(case.workload)
        await self._scenery.create_waiting(case.workload, case.contestant)
        try:
            async with self._warm(case, show) as (process, go):
                figures = await self._drain(case, process, go, show("bound", case.pods))
                if self._has_latency(case, figures):
                    await self._rest(process)
                    figures |= await self._latency(case)
        finally:
            await self._scenery.sweep()
        return figures

    @contextlib.asynccontextmanager
    async def _warm(self, case: Case, show: Show) -> AsyncIterator[tuple[Process, Go]]:
        """The contestant with all pods to come and whatever waits behind it, and what lets it go."""
        contestant, by_lease = case.contestant, not case.workload.waiting
        await (contestants.hold_lease if by_lease else contestants.drop_lease)(self._client, contestant)
        if by_lease:
            await self._create(case)
        start = partial(contestants.start, self._cp, contestant, case.workload, leader_elect=by_lease)
        process = await asyncio.to_thread(start)
        try:
            await self._waiters_refused(case, show)
            await self._rest(process)
            if by_lease:
                yield process, partial(contestants.drop_lease, self._client, contestant)
            else:
                process.pause()
                await self._create(case)
                yield process, partial(asyncio.to_thread, process.resume)
        finally:
            await asyncio.to_thread(process.stop)

    async def _waiters_refused(self, case: Case, show: Show) -> None:
        """Those that cannot be placed have been tried and told so."""
        wanted = case.workload.waiting
        if not wanted or not case.contestant.decides:
            return
        async with PodWatch(self._client, NAMESPACE, selector("waiting", case.contestant)) as watch:
            if not await watch.all_refused(wanted, stall_s=REFUSE_S, progress=show("refused", wanted)):
                raise TimeoutError(f"{len(watch.refused)} of {wanted} waiting pods were refused")

    async def _drain(self, case: Case, process: Process, go: Go, progress: Callable[[int], None]) -> Figures:
        churn = Churn(self._client, case.contestant, self._size).running() if case.workload.churn else nullcontext()
        async with (
            PodWatch(self._client, NAMESPACE, selector("measured", case.contestant)) as watch,
            EventWatch(self._client, NAMESPACE) as events,
        ):
            await self._collect()
            before = self._cpu(process)
            await go()
            async with churn:
                await watch.bound(case.pods, timeout_s=60 + case.pods / 4, progress=progress)
            if case.contestant.events:
                await events.written(len(watch.bound_s), timeout_s=60)
            after, rss_bytes = self._cpu(process), usage(process.pid).rss_bytes
        done = len(watch.bound_s)
        spent = {f"{name} CPU ms/pod": 1000 * (after[name] - before[name]) / max(1, done) for name in before}
        return _rates(case, watch, events) | spent | {"RSS MB": rss_bytes / 1e6}

    def _has_latency(self, case: Case, figures: Figures) -> bool:
        """A scheduler that cannot keep up has no latency but a queue, and Events make no difference to the bare client."""
        keeps_up = figures["pods/s"] > 1.2 * self._rates.latency_rate
        return bool(self._rates.latency_pods) and case.workload.latency and case.contestant.events and keeps_up

    async def _latency(self, case: Case) -> Figures:
        created_s: dict[str, float] = {}

        async def create(name: str) -> None:
            # From before the request: on a busy machine its answer may be read after the watch has shown the bind.
            created_s[name] = time.monotonic()
            obj = case.pod(name)
            await self._client.create(PODS, obj, namespace=NAMESPACE)

        async with PodWatch(self._client, NAMESPACE, selector("measured", case.contestant)) as watch:
            await self._collect()
            there = len(watch.bound_s)
            start = time.monotonic()
            async with asyncio.TaskGroup() as group:
                for index in range(self._rates.latency_pods):
                    await asyncio.sleep(max(0.0, start + index / self._rates.latency_rate - time.monotonic()))
                    group.create_task(create(f"late-{index:05}"))
            await watch.bound(there + self._rates.latency_pods, timeout_s=60)
        waits = [1000 * (watch.bound_s[name] - when) for name, when in created_s.items() if name in watch.bound_s]
        return {f"create→bound p{percent} ms": percentile(waits, percent) for percent in (50, 99)}

    async def _create(self, case: Case) -> None:
        names = [f"measured-{index:05}" for index in range(case.pods)]
        await self._scenery.create_claims(case.workload, names)
        objects = map(case.pod, names)
        await load.create(self._client, PODS, objects, namespace=NAMESPACE)

    async def _collect(self) -> None:
        """Have the API server collect its garbage now: one collection costs as much as a thousand binds, and who got it was luck."""
        await self._client.request("GET", "/debug/pprof/heap?gc=1")

    def _cpu(self, process: Process) -> dict[str, float]:
        return {
            "scheduler": usage(process.pid).cpu_s,
            "API server": self._cp.process("kube-apiserver").cpu_seconds(),
            "etcd": self._cp.process("etcd").cpu_seconds(),
        }

    async def _rest(self, process: Process) -> None:
        """Wait until the scheduler has read the cluster and tried what waits."""
        deadline = time.monotonic() + SETTLE_S
        before, quiet = process.cpu_seconds(), 0
        while time.monotonic() < deadline:
            await asyncio.sleep(REST_STEP_S)
            now = process.cpu_seconds()
            quiet = quiet + 1 if now > STARTED_S and now - before < REST * REST_STEP_S else 0
            if quiet == REST_STEPS:
                return
            before = now
        raise TimeoutError(f"{process.name} does not come to rest, its log: {process.log_path}")


def _rates(case: Case, watch: PodWatch, events: EventWatch) -> Figures:
    done, bound_s = len(watch.bound_s), max(watch.bound_s.values(), default=0.0)
    figures = {
        "pods/s": rate(done, max(bound_s, events.last_s) - watch.first_change_s),
        "binds/s": rate(done, bound_s - watch.first_change_s),
    }
    if done < case.pods:
        figures["never bound"] = case.pods - done
    if case.contestant.events and events.count < done:
        figures["Events missing"] = done - events.count
    return figures


def rate(count: int, seconds: float) -> float:
    """The first of `count` starts the clock."""
    return (count - 1) / seconds if count > 1 and seconds > 0 else 0.0


def pods_for(workload: Workload, contestant: Contestant, *, pods: int | None, vs_pods: int | None) -> int:
    """How many pods a contestant gets: kube-scheduler fewer where it is an order of magnitude slower."""
    mine = pods or workload.pods
    if contestant is KUBE_SCHEDULER:
        return vs_pods or min(mine, workload.slow_pods)
    return mine
