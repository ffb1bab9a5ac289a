"""A controller with doubles for everything it works with and a clock of the test's own, and pods for the caches."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import msgspec
from prometheus_client.parser import text_string_to_metric_families
from tests.support.factories import make_deployment, make_pod

from robotapp_api.model.names import Label
from robotapp_claims.rules.objects import OwnerReference
from robotapp_operator.plan.spec.objects import ReplicaSet
from robotapp_operator.queue.work import BACKGROUND
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.reconcile.controller import Controller
from robotapp_operator.reconcile.metrics import Metrics
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Worker:
    """Stands for every collaborator: notes calls, answers or raises what the test says."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.answer: Any = True
        self.forget: Callable[[str], None] = lambda _: None
        self.effect: Callable[[], None] = lambda: None
        self.awaits_s: Callable[[str, str], float] = lambda *_: 0.0
        self.due_s: Callable[[str, str], float] = lambda *_: 0.0

    async def work(self, *args: Any) -> Any:
        self.calls.append(args)
        self.effect()
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer

    reconcile = report = publish = open = look = work


class StubbedController:
    def __init__(self) -> None:
        self.clock = Clock()
        self.now = datetime(2026, 1, 1, tzinfo=UTC)
        self.cache = Cache()
        self.memory = ReconcileState()
        self.metrics = Metrics()
        self.queue = Queue(clock=self.clock, jitter=lambda: 0.5, background=BACKGROUND)
        self.children, self.reporter, self.fleet, self.gates = (Worker() for _ in range(4))
        self.objects, self.probes, self.pools, self.mover = (Worker() for _ in range(4))
        self.pod_events, self.expiry = Worker(), Worker()
        self.pod_events.answer = self.reporter.answer = self.objects.answer = self.mover.answer = None
        self.expiry.answer = None
        self.children.forget = self.memory.forget
        self.listed: list[dict[str, Any]] = []
        self.while_listing: Callable[[], None] = lambda: None
        self.woken = 0
        self.controller = Controller(
            self.cache,
            self.queue,
            self.memory,
            self.metrics,
            children=self.children,  # type: ignore[arg-type] - doubles
            objects=self.objects,  # type: ignore[arg-type]
            reporter=self.reporter,  # type: ignore[arg-type]
            fleet=self.fleet,  # type: ignore[arg-type]
            pod_events=self.pod_events,  # type: ignore[arg-type]
            gates=self.gates,  # type: ignore[arg-type]
            expiry=self.expiry,  # type: ignore[arg-type]
            mover=self.mover,  # type: ignore[arg-type]
            probes=self.probes,  # type: ignore[arg-type]
            pools=self.pools,  # type: ignore[arg-type]
            list_apps=self._list,
            request_sweep=self._wake,
            now=lambda: self.now,
        )

    async def _list(self) -> set[str]:
        self.while_listing()
        return {self.cache.update_app(body).uid for body in self.listed}

    def _wake(self) -> None:
        self.woken += 1

    async def handle(self, key: Key) -> None:
        self.queue.add(key)
        item = self.queue.pop(background=key.work in BACKGROUND)
        assert item is not None
        await self.controller._handle(*item)

    def due(self, seconds: float = 0.0) -> set[Key]:
        """Everything that becomes due within `seconds`."""
        self.clock.now_s += seconds
        found = set()
        while item := self.queue.pop() or self.queue.pop(background=True):
            found.add(item[0])
            self.queue.done(item[0])
        return found

    def reconciles(self) -> dict[tuple[str, str], float]:
        families = text_string_to_metric_families(self.metrics.render().decode())
        return {
            (sample.labels["controller"], sample.labels["result"]): sample.value
            for family in families
            for sample in family.samples
            if sample.name == "controller_runtime_reconcile_total"
        }


def place(cache: Cache, uid: str, **nodes: str) -> None:
    """Per component of an app without robots: a Deployment, its ReplicaSet, and a pod on this node."""
    for name, node in nodes.items():
        owner = OwnerReference(kind="RobotApp", name="teleop", uid=uid, controller=True)
        deployment = make_deployment(name, uid=f"d-{name}")
        meta = msgspec.structs.replace(
            deployment.metadata, labels={Label.COMPONENT.value: name}, owner_references=(owner,)
        )
        cache.deployments.put(uid, name, msgspec.structs.replace(deployment, metadata=meta))
        chain = {"metadata": {"uid": f"rs-{name}", "ownerReferences": [{"uid": f"d-{name}", "controller": True}]}}
        cache.put_replica_set(msgspec.convert(chain, ReplicaSet))
        owners = {"ownerReferences": [{"uid": f"rs-{name}", "controller": True}]}
        cache.pods.put(uid, name, make_pod(name, node=node, metadata=owners))
