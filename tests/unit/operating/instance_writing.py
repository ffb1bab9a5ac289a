"""An API server in memory and the part of an operator that writes RobotAppInstances."""

from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
from tests.support.apiserver import FakeApiServer
from tests.support.factories import app_body

from robotapp_api.model.instance import RobotAppInstance
from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_client import ApiClient
from robotapp_client.api.resources import ROBOTAPPINSTANCES, ROBOTAPPS
from robotapp_operator.plan.render.instance_object import AppInstance
from robotapp_operator.reconcile.instance_objects import InstanceObjects
from robotapp_operator.reconcile.observer import Observer
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache

REFUSED = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")


class WrittenInstances:
    """A server and one operator. No informers: `mirror` does their work for RobotAppInstances."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.cache = Cache()
        self.memory = ReconcileState()
        self.now_s = 1000.0
        self.conflicts: dict[tuple[str, str], str] = {}
        observer = Observer(self.cache, self.memory, clock=lambda: self.now_s, on_change=lambda *_: None)
        self.objects = InstanceObjects(
            client,
            self.cache,
            self.memory,
            observer,
            conflict_of=lambda uid, instance: self.conflicts.get((uid, instance), ""),
            clock=lambda: self.now_s,
            now=lambda: datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=self.now_s),
        )

    async def app(self, name: str = "teleop", **spec: Any) -> str:
        body = app_body(name, **spec)
        body["metadata"] = {"name": name, "namespace": "default"}
        return self.cache.update_app(await self.client.create(ROBOTAPPS, body)).uid

    async def stored(self) -> list[dict[str, Any]]:
        items = (await self.client.list(ROBOTAPPINSTANCES)).items
        for item in items:
            RobotAppInstance.model_validate(item)
        return items

    async def mirror(self) -> None:
        live = {item["metadata"]["uid"]: msgspec.convert(item, AppInstance) for item in await self.stored()}
        for known in list(self.cache.instance_object_named.values()):
            if known.metadata.uid not in live:
                self.cache.drop_instance_object(known)
        for item in live.values():
            self.cache.put_instance_object(item)

    async def settle(self, uid: str, instance: str = "", *, most: int = 10) -> None:
        """Let the key be worked on as often as it asks for, and as the events of its writes would have it."""
        for _ in range(most):
            await self.mirror()
            before = self.writes()
            again_s = await self.objects.publish(uid, instance)
            if again_s is None and self.writes() == before:
                return
            self.now_s += again_s or 0.0
        raise AssertionError("it never comes to rest")

    def writes(self) -> int:
        return sum(method != "GET" for method, _ in self.api.requests)

    def refuse(self, uid: str, instance: str = "") -> None:
        self.memory.of(uid).outcomes[instance] = REFUSED
