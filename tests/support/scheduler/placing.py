"""A scheduling loop with a scripted binder and reserver, for tests of what follows from each outcome of a bind."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from prometheus_client import CollectorRegistry
from tests.support.scheduler.queue_checks import check_queue
from tests.support.scripted import ScriptedClient

from robotapp_api.model.names import Annotation, Label
from robotapp_client.transport.errors import Unreachable
from robotapp_scheduler.core.api.core_v1 import Metadata, Node, NodeStatus, Pod, PodSpec
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.framework.handle import READY, BindOutcome, BindResult, Handle, Reserved
from robotapp_scheduler.core.framework.profiles import Catalogue, PluginRef, PluginSet, ProfileSpec, build_profiles
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.preemption.preemption import Plan
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.plugins.kubernetes.dynamic_resources.plugin import DynamicResources
from robotapp_scheduler.plugins.kubernetes.volumes.volume_binding import VolumeBinding
from robotapp_scheduler.plugins.ros.bind import ROSBind
from robotapp_scheduler.plugins.ros.reserve import ROSReserve
from robotapp_scheduler.shell.binding.binding_cycle import BindingCycle
from robotapp_scheduler.shell.binding.claim_waits import ClaimWaits
from robotapp_scheduler.shell.binding.domain_checks import DomainChecks
from robotapp_scheduler.shell.metrics.metrics import Metrics
from robotapp_scheduler.shell.planner.planner import Planner
from robotapp_scheduler.shell.process.loop import SchedulerLoop
from robotapp_scheduler.shell.status.pod_group_status import GroupReporter

OURS = "ours"
BINDING: Final[Mapping[str, type]] = {"ROSBind": ROSBind}
CLAIMING: Final[Mapping[str, type]] = {
    "ROSReserve": ROSReserve,
    "VolumeBinding": VolumeBinding,
    "DynamicResources": DynamicResources,
}
POINTS: Final[Mapping[str, Sequence[str]]] = {
    "reserve": ("ROSReserve", "DynamicResources"),
    "preBind": ("VolumeBinding", "DynamicResources"),
    "postBind": ("ROSReserve",),
}
"""Where these take part: nothing is filtered or scored by them."""


class Fifo:
    name = "Fifo"
    events = Change.NONE

    def queue_key(self, _pod: PodInfo, queued_s: float) -> tuple[float]:
        return (queued_s,)


class Scripted:
    """Binder and reserver in one: answers in order, else success; records what it was asked."""

    def __init__(self) -> None:
        self.binds: deque[Any] = deque()
        self.reservations: deque[Reserved | Exception] = deque()
        self.domains: Reserved | Exception = READY
        self.full: Reserved | None = None
        """What is known without a look."""
        self.started = asyncio.Event()
        self.asked: list[tuple[str, str, Mapping[str, str], str]] = []
        self.checked: list[list[tuple[str, str]]] = []
        """Pods whose domains were checked with one read, each with its node."""
        self.claimed: list[tuple[str, str]] = []
        """Pods that were to have their devices and domain claimed, each with its node."""
        self.sharing: list[str] = []
        """How the claims of shared devices ended: `given back` or `bound`."""

    def send(self, pod: Pod, node: str, told: Callable[[Exception | None], None]) -> None:
        """Success, or an error that makes `bind` give its scripted answer."""
        self.asked.append((pod.metadata.name, node, {}, ""))
        self.started.set()
        error = Unreachable("scripted", maybe_applied=True) if self.binds else None
        asyncio.get_running_loop().call_soon(told, error)

    async def bind(
        self,
        pod: Pod,
        node: str,
        *,
        annotations: Mapping[str, str] | None = None,
        resource_version: str = "",
        refused: Exception | None = None,
    ) -> BindOutcome:
        if refused is None:
            self.asked.append((pod.metadata.name, node, dict(annotations or {}), resource_version))
        self.started.set()
        await asyncio.sleep(0)
        answer = self.binds.popleft() if self.binds else BindOutcome(BindResult.BOUND, node=node)
        if isinstance(answer, Exception):
            raise answer
        return answer() if isinstance(answer, Callable) else answer  # type: ignore[arg-type]

    async def reserve(self, pod: PodInfo, node: str, _wanted: Sequence[DeviceGrant]) -> Reserved:
        self.claimed.append((pod.name, node))
        return given(self.reservations.popleft()) if self.reservations else READY

    def known_full(self, _pod: PodInfo) -> Reserved | None:
        return self.full

    async def bound(self, _reserved: Reserved) -> None:
        self.sharing.append("bound")

    async def not_bound(self, _pod: PodInfo, _reserved: Reserved) -> None:
        self.sharing.append("given back")

    async def check_domains(self, placed: Sequence[tuple[PodInfo, str]]) -> dict[str, Reserved]:
        self.checked.append([(pod.name, node) for pod, node in placed])
        return {pod.uid: given(self.domains) for pod, _ in placed}


def given(answer: Reserved | Exception) -> Reserved:
    if isinstance(answer, Exception):
        raise answer
    return answer


class ScriptedClaims:
    """Resource claims that are written at once, or never, for a reason."""

    def __init__(self) -> None:
        self.trouble = ""
        self.bound: list[str] = []
        """Pods that were to become users of their resource claims."""
        self.released: list[str] = []
        self.deallocated: list[str] = []

    async def bind(self, pod: PodInfo, _plan: ClaimPlan) -> str:
        self.bound.append(pod.name)
        return self.trouble

    async def release(self, pod: PodInfo, _plan: ClaimPlan) -> None:
        self.released.append(pod.name)

    def deallocate(self, claim: ResourceClaim, _pod: PodInfo) -> None:
        self.deallocated.append(claim.metadata.name)


class ScriptedVolumes:
    """Volumes that are bound at once, or not before `ready`, or never, for a reason."""

    def __init__(self) -> None:
        self.trouble = ""
        self.ready = asyncio.Event()
        self.ready.set()
        self.asked: list[str] = []

    async def bind(self, pod: PodInfo, _plan: VolumePlan) -> str:
        self.asked.append(pod.name)
        await self.ready.wait()
        return self.trouble


def handle_of(
    io: Scripted,
    *,
    volumes: ScriptedVolumes | None = None,
    resource_claims: ScriptedClaims | None = None,
    metrics: Metrics | None = None,
) -> Handle:
    volumes = volumes or ScriptedVolumes()
    checks = DomainChecks(io.check_domains, metrics or Metrics(CollectorRegistry()), clock=lambda: 0.0)
    return Handle(
        pods=io, domains=checks, claims=io, volumes=volumes, resource_claims=resource_claims or ScriptedClaims()
    )


class Said:
    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []
        self.nominated: dict[str, str | None] = {}
        self.broken_for = ""
        self.more = ""
        """What was added to the latest word of a bind."""

    def scheduled(self, pod: Pod, node: str, *, more: str = "") -> None:
        self.more = more
        self.lines.append(("scheduled", pod.metadata.name, node))

    def unscheduled(self, pod: Pod, *, reason: str, message: str, nominate: str | None = None) -> None:
        if pod.metadata.name == self.broken_for:
            raise RuntimeError("cannot tell")
        self.nominated[pod.metadata.name] = nominate
        self.lines.append((str(reason), pod.metadata.name, message))

    def tick(self) -> None: ...

    async def write_nomination(self, pod: Pod, node: str) -> None:
        self.nominated[pod.metadata.name] = node

    def note(self, pod: Pod, *, reason: str, text: str) -> None:
        self.lines.append((str(reason), pod.metadata.name, text))


class Rig:
    """The loop and binding cycle around the real core, with scripted writes."""

    def __init__(
        self, nodes: int = 2, *, plugins: Mapping[str, type] = BINDING, points: Mapping[str, Sequence[str]] = POINTS
    ) -> None:
        self.now_s = 0.0
        defaults = (PluginRef("Fifo"), *map(PluginRef, plugins))
        catalogue = Catalogue(classes={"Fifo": Fifo, **plugins, **CLAIMING}, defaults=defaults)
        points = {point: PluginSet(enabled=tuple(map(PluginRef, names))) for point, names in points.items()}
        profiles = build_profiles([ProfileSpec(scheduler_name=OURS, plugins=points)], catalogue)
        self.core = SchedulerCore(Cache(clock=self.clock), profiles, clock=self.clock)
        for index in range(nodes):
            status = NodeStatus(allocatable={"cpu": "4", "pods": "10"})
            self.core.cluster.apply_node(Node(metadata=Metadata(name=f"n{index}"), status=status))
        self.io = Scripted()
        self.volumes = ScriptedVolumes()
        self.claims = ScriptedClaims()
        self.said = Said()
        self.metrics = Metrics(CollectorRegistry())
        self.waiting: dict[str, Pod] = {}
        self.evicted: list[tuple[Plan, PodInfo]] = []
        binding_cycle = BindingCycle(
            self.core,
            handle=handle_of(self.io, volumes=self.volumes, resource_claims=self.claims, metrics=self.metrics),
            claim_waits=ClaimWaits(self.core, self.io, self.said, waiting=self.waiting),  # type: ignore[arg-type]
            reporter=self.said,  # type: ignore[arg-type]
            metrics=self.metrics,
            waiting=self.waiting,
            clock=self.clock,
            evict=lambda plan, pod: self.evicted.append((plan, pod)),
        )
        self.leads = True
        self.loop = SchedulerLoop(
            self.core,
            binding_cycle,
            self.said,  # type: ignore[arg-type]
            self.metrics,
            planner=Planner(),
            groups=GroupReporter(ScriptedClient(), self.core.cluster.pod_groups, permitted=lambda: self.leads),
            clock=self.clock,
            permitted=lambda: self.leads,
        )

    def clock(self) -> float:
        return self.now_s

    def show(
        self,
        name: str = "p",
        *,
        labels: dict[str, str] | None = None,
        annotations: dict[str, str] | None = None,
        wishes: bool = False,
        **spec: Any,
    ) -> None:
        """With `wishes` something is to be claimed before the pod may be bound: the reserver is asked."""
        annotations = {str(Annotation.DDS_DOMAIN): "auto"} if wishes else annotations
        meta = Metadata(name=name, namespace="a", uid=f"uid-{name}", labels=labels, annotations=annotations)
        pod = Pod(metadata=meta, spec=PodSpec(scheduler_name=OURS, **spec))
        self.waiting[meta.uid] = pod
        self.core.cluster.apply_pod(pod)
        self.core.queue.add(pod)

    async def carry_out(self, *names: str) -> None:
        """Decide about these app pods as one batch, and let the loop finish it."""
        for name in names:
            self.show(name, labels={str(Label.APP_UID): "app-1"})
        batch = [queued for _ in names for queued in self.core.queue.pop()]
        self.loop._decide(batch)
        await self.loop.drain(1.0)
        check_queue(self.core.queue)

    def with_volumes(self, *names: str) -> None:
        """Decisions about these pods have volumes to be bound first."""
        decide = self.core.schedule

        def decided(batch: Any, **options: Any) -> list[ScheduleResult]:
            decisions = decide(batch, **options)
            for decision in decisions:
                if decision.placed and decision.pod.name in names:
                    decision.volumes = VolumePlan(str(decision.node), (), (("default", "map"),), 600.0)
            return decisions

        self.core.schedule = decided  # type: ignore[method-assign]  # the only way in for a decision made by a plugin

    async def turn(self) -> None:
        """Let the loop run until nothing moves."""
        task = asyncio.create_task(self.loop.run())
        for _ in range(60):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        check_queue(self.core.queue)

    def count(self, result: str) -> float:
        return self.metrics.attempt_s.labels(result, OURS).count
