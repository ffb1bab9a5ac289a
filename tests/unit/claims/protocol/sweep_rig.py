"""A store, a clock and a sweeper, for unit tests of the sweep."""

from collections.abc import Awaitable, Callable

from tests.support.claims.objects import app_holder, app_json, pool_json
from tests.support.claims.store import Store

from robotapp_claims.protocol.devices import reserve_devices
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.device import chosen
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Holder
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client.api.resources import (
    DOMAINPOOLS,
    ROBOTAPPS,
    ROBOTCLAIMS,
)


class SweepRig:
    """A store, a clock and one sweeper."""

    def __init__(self, **app_spec: object) -> None:
        self.store = Store()
        self.store.put(DOMAINPOOLS, pool_json("1-3", quarantine_s=60))
        self.now = 1000.0
        self.conflicts: list[ClaimConflict] = []
        self.sweeper = self.another()
        self.app = self.new_app("teleop", **app_spec)

    def another(self, **options: object) -> Sweeper:
        return Sweeper(self.store.client(), clock=lambda: self.now, on_conflicts=self.conflicts.extend, **options)  # type: ignore[arg-type]  # a factory

    def new_app(self, name: str, **spec: object) -> Holder:
        spec = {"components": [{"name": "driver", "devices": [{"name": "bus", "type": "can"}]}]} | spec
        return app_holder(self.store.put(ROBOTAPPS, app_json(name, **spec))["metadata"]["uid"], name=name)

    async def domain(self, holder: Holder | None = None) -> str:
        return (await ensure_domain(self.store.client(), DomainRequest(holder or self.app))).claim

    async def device(self, pod_uid: str, holder: Holder | None = None) -> str:
        device = chosen(node="edge-1", device_id="can-can0", device_type="can", identity="")
        mine = holder or app_holder(self.app.uid, component="driver")
        found = await reserve_devices(
            self.store.client(), holder=mine, pod_uid=pod_uid, node="edge-1", devices=[device]
        )
        assert found.ok, found.message
        return device.claim

    def delete_app(self) -> None:
        self.store.remove(ROBOTAPPS, "teleop", "team")

    def phase(self, name: str) -> str:
        claim = self.store.find(ROBOTCLAIMS, name)
        return "gone" if claim is None else claim["status"]["phase"]

    async def sweep(self, *, after_s: float = 0.0) -> None:
        self.now += after_s
        await self.sweeper.sweep_once()


def number(name: str) -> int:
    return int(name.rpartition(".")[2])


def refuse(prefix: str, error: Exception) -> Callable[[str], Awaitable[None]]:
    async def gate(what: str) -> None:
        if what.startswith(prefix):
            raise error

    return gate
