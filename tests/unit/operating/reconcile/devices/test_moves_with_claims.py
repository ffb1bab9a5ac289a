"""onLoss Reschedule of a component whose devices a driver hands over: its claim goes with the pod, or the pod stays."""

from collections.abc import AsyncIterator

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import UID
from tests.unit.operating.reconcile.test_mover import Scene

from robotapp_api.model.names import POD_CLAIM, Annotation, Label
from robotapp_claims.rules.objects import ResourceClaim, ResourceClaimStatus, ResourceSlice, TelemetryDevice
from robotapp_client.api.resources import DEPLOYMENTS, RESOURCECLAIMS
from robotapp_operator.reconcile.mover import LOST_S
from robotapp_operator.watch.facts.device_facts import device_losses

CLAIM = "planner"


class ClaimScene(Scene):
    """The planner's pod has the camera of node far by a ResourceClaim; node near has another one."""

    async def with_claim(self) -> None:
        await self.app(on_loss="Reschedule")
        pod_spec = {"resourceClaims": [{"name": POD_CLAIM, "resourceClaimName": CLAIM}]}
        patch = {"spec": {"template": {"spec": pod_spec}}}
        deployed = await self.client.list(DEPLOYMENTS)
        names = [item["metadata"]["name"] for item in deployed.items]
        await self.client.patch(
            DEPLOYMENTS, next(name for name in names if "planner" in name), patch, namespace="default"
        )
        labels = {Label.APP_UID.value: UID, Label.INSTANCE.value: "", Label.COMPONENT.value: "planner"}
        owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "t", "uid": UID, "controller": True}
        meta = {"name": CLAIM, "namespace": "default", "labels": labels, "ownerReferences": [owner]}
        await self.mirror()
        pod = self.cache.pods.of(UID)["planner"]
        result = {"request": "cam", "driver": "devices.robotics.io", "pool": "far", "device": "usb-cam"}
        status = {
            "allocation": {"devices": {"results": [result]}},
            "reservedFor": [{"resource": "pods", "name": "planner", "uid": pod.metadata.uid}],
        }
        await self.client.create(RESOURCECLAIMS, {"metadata": meta}, namespace="default")
        (claim,) = await self.claims()
        allocated = msgspec.structs.replace(claim, status=msgspec.convert(status, ResourceClaimStatus))
        self.cache.allocations.put_claim(allocated, before=None)
        self.runs_driver("far")

    def runs_driver(self, node: str) -> None:
        body = {"metadata": {"name": f"{node}-s"}, "spec": {"driver": "devices.robotics.io", "nodeName": node}}
        self.cache.allocations.put_slice(msgspec.convert(body, ResourceSlice))

    def see(self, node: str, *, present: bool) -> None:
        self.devices[node] = [TelemetryDevice(id="usb-cam", type="usb", interface="cam", present=present)]
        self.cache.reported_devices += 1

    async def claims(self) -> list[ResourceClaim]:
        return (await self.client.list(RESOURCECLAIMS, as_type=ResourceClaim)).items

    async def lose(self) -> None:
        """The camera of node far is gone for so long that it is lost."""
        self.see("far", present=False)
        await self.look()
        await self.look(later_s=LOST_S)
        await self.look()


@pytest.fixture
async def world() -> AsyncIterator[ClaimScene]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        scene = ClaimScene(api, client)
        await scene.with_claim()
        yield scene


async def test_the_pod_is_counted_and_evicted_and_its_claim_deleted_so_that_another_device_is_chosen(
    world: ClaimScene,
) -> None:
    world.runs_driver("near")
    world.see("near", present=True)
    await world.lose()
    assert await world.pods() == ["driver"]
    assert await world.claims() == []
    assert len((await world.annotation(Annotation.MOVES))["times"]) == 1


async def test_a_node_without_the_driver_is_no_other_place(world: ClaimScene) -> None:
    world.see("near", present=True)
    await world.lose()
    assert await world.pods() == ["driver", "planner"]
    assert len(await world.claims()) == 1
    assert world.device_stays() == "no other node has such a device that is free"


async def test_a_claim_that_a_scheduler_wrote_meanwhile_stays_for_the_pod_that_was_bound_with_it(
    world: ClaimScene,
) -> None:
    world.runs_driver("near")
    world.see("near", present=True)
    await world.client.patch(RESOURCECLAIMS, CLAIM, {"metadata": {"labels": {"x": "y"}}}, namespace="default")
    await world.lose()
    assert await world.pods() == ["driver"]
    assert len(await world.claims()) == 1


async def test_losses_of_both_ledgers_count_where_many_at_once_are_a_mistake_of_the_agent(world: ClaimScene) -> None:
    world.see("far", present=False)
    await world.mirror()
    assert device_losses(world.cache).lost.keys() == {"far"}
