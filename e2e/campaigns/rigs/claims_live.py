"""One namespace and one pool on the real API server, with our components' own identities."""

import asyncio
import contextlib
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
from tests.support.apiobjects import ROS
from tests.support.claims.objects import app_holder, deployment_json, pod_json
from tests.support.clients import client_for

from robotapp_claims.protocol.devices import Reservation, reserve_devices
from robotapp_claims.protocol.domains import ensure_domain, find_claim
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.device import chosen
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.identity import holder_of_app
from robotapp_claims.rules.objects import Claim, Holder
from robotapp_client import ApiClient, load
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, PODS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_testbed import ControlPlane

Json = dict[str, Any]


@dataclass
class Live:
    """admin makes objects as people and controllers do; operator and scheduler are what we ship."""

    plane: ControlPlane
    namespace: str
    admin: ApiClient
    operator: ApiClient
    scheduler: ApiClient
    pool: str = field(default_factory=lambda: f"p{secrets.token_hex(3)}")
    node: str = field(default_factory=lambda: f"edge-{secrets.token_hex(3)}")

    async def make_pool(self, ids: str = "1-5", *, quarantine_s: int = 1) -> None:
        spec = {"network": self.pool, "ids": ids, "quarantineSeconds": quarantine_s}
        await self.admin.create(DOMAINPOOLS, {"metadata": {"name": self.pool}, "spec": spec})

    async def make_app(self, name: str = "teleop", **spec: Any) -> DomainRequest:
        components = [{"name": "driver", "image": "x", "devices": [{"name": "bus", "type": "can"}]}]
        body = {
            "metadata": {"name": name, "namespace": self.namespace},
            "spec": {"ros": ROS, "components": components, "ros2": {"pool": self.pool}} | spec,
        }
        uid = (await self.admin.create(ROBOTAPPS, body))["metadata"]["uid"]
        return DomainRequest(holder_of_app(namespace=self.namespace, name=name, uid=uid), pool=self.pool)

    async def delete_app(self, name: str = "teleop") -> None:
        await self.admin.delete(ROBOTAPPS, name, namespace=self.namespace, propagation="Background")

    async def write_deployment(self, client: ApiClient, request: DomainRequest, outcome: DomainOutcome) -> None:
        """The operator's template write: create when absent, else with the fence."""
        holder = request.holder
        name = f"{holder.name}-driver"
        fence = outcome.fences.get(name)
        body = deployment_json(outcome.id, uid=holder.uid, name=name, claim=outcome.claim, app=holder.name)
        labels = body["metadata"]["labels"]
        template = body["spec"]["template"]
        template["metadata"]["labels"] = labels
        template["spec"]["containers"][0]["image"] = "x"
        template["spec"] |= {"schedulerName": "nobody", "terminationGracePeriodSeconds": 0}
        body["metadata"] |= {"namespace": self.namespace, "ownerReferences": [owner(holder)]}
        body["spec"]["selector"] = {"matchLabels": {"robotics.io/app": labels["robotics.io/app"]}}
        if fence is None:
            await client.create(DEPLOYMENTS, body, namespace=self.namespace)
        else:
            body["metadata"] |= {"uid": fence.uid, "resourceVersion": fence.resource_version}
            await client.apply(DEPLOYMENTS, body, namespace=self.namespace)

    async def operate(self, client: ApiClient, request: DomainRequest) -> DomainOutcome:
        """What the operator does for one app: the domain, then the template unless it says so already."""
        outcome = await ensure_domain(client, request)
        if outcome.id is not None and (not outcome.fences or outcome.unheld):
            await self.write_deployment(client, request, outcome)
        return outcome

    async def make_pod(
        self,
        name: str,
        holder: Holder | None,
        number: int | None = None,
        *,
        claim: str = "",
        gates: Sequence[Json] = (),
    ) -> Json:
        notes = {"robotics.io/domain-claim": claim} if claim else {}
        uid, app = (holder.uid, holder.name) if holder else ("", "")
        body = pod_json(number, name=name, uid=uid, annotations=notes, app=app)
        body["metadata"]["namespace"] = self.namespace
        body["spec"] |= {"schedulerName": "nobody", "terminationGracePeriodSeconds": 0, "schedulingGates": [*gates]}
        body["spec"]["containers"][0]["image"] = "x"
        body.pop("status")
        return await self.admin.create(PODS, body, namespace=self.namespace)

    async def delete_pod(self, name: str) -> None:
        await self.admin.delete(PODS, name, namespace=self.namespace)

    async def bind(self, client: ApiClient, pod: Json, *, annotations: dict[str, str] | None = None) -> None:
        meta = pod["metadata"]
        body = {
            "apiVersion": "v1",
            "kind": "Binding",
            "metadata": {"name": meta["name"], "uid": meta["uid"], "annotations": annotations or {}},
            "target": {"kind": "Node", "name": self.node},
        }
        await client.post_raw(PODS.path(self.namespace, meta["name"], "binding"), msgspec.json.encode(body))

    async def reserve(self, pod_uid: str, holder: Holder, *, client: ApiClient | None = None) -> Reservation:
        device = chosen(node=self.node, device_id="can-can0", device_type="can", identity="")
        return await reserve_devices(
            client or self.scheduler, holder=holder, pod_uid=pod_uid, node=self.node, devices=[device]
        )

    def driver(self, request: DomainRequest) -> Holder:
        return app_holder_in(self.namespace, request.holder.name, request.holder.uid, component="driver")

    async def claims(self) -> list[Claim]:
        """All claims of this namespace."""
        selector = f"spec.holder.namespace={self.namespace}"
        return (await self.admin.list(ROBOTCLAIMS, field_selector=selector, as_type=Claim)).items

    async def phase(self, name: str) -> str:
        claim = await find_claim(self.admin, name)
        return "gone" if claim is None else claim.status.phase

    def sweeper(self, client: ApiClient | None = None, **options: Any) -> Sweeper:
        """Sweeps this namespace only: other tests share the cluster."""
        return Sweeper(client or self.operator, namespaces=(self.namespace,), **options)


def owner(holder: Holder) -> Json:
    return {
        "apiVersion": holder.api_version,
        "kind": holder.kind,
        "name": holder.name,
        "uid": holder.uid,
        "controller": True,
    }


def app_holder_in(namespace: str, name: str, uid: str, *, component: str = "") -> Holder:
    template = app_holder(uid, component=component, name=name)
    return msgspec.structs.replace(template, namespace=namespace)


@contextlib.asynccontextmanager
async def live(plane: ControlPlane, namespace: str) -> AsyncIterator[Live]:
    async with contextlib.AsyncExitStack() as stack:
        clients = [
            await stack.enter_async_context(client_for(load(plane.kubeconfig(name)), timeout_s=20))
            for name in ("admin", "operator", "scheduler")
        ]
        place = Live(plane, namespace, *clients)
        yield place
        for claim in await place.claims():
            await place.admin.delete(ROBOTCLAIMS, claim.name)
        with contextlib.suppress(Exception):
            await place.admin.delete(DOMAINPOOLS, place.pool)


@contextlib.asynccontextmanager
async def looping(sweeper: Sweeper) -> AsyncIterator[None]:
    task = asyncio.create_task(sweeper.run())
    try:
        yield
    finally:
        task.cancel()


async def until(condition: Callable[[], Awaitable[object]], *, timeout_s: float = 60.0) -> None:
    """Poll an awaitable condition with a deadline."""
    deadline = time.monotonic() + timeout_s
    while not await condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"{condition.__qualname__} not met in {timeout_s} s")
        await asyncio.sleep(0.02)
