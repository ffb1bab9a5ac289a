"""The devices of a suspended app are free, whatever else its spec says."""

from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import make_node
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Label
from robotapp_claims.rules.objects import ResourceClaim, ResourceSlice
from robotapp_client.api.resources import RESOURCECLAIMS
from robotapp_operator.plan.spec.objects import Pod


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        yield ReconciledServer(api, client)


@pytest.mark.parametrize("spec", [{"ros": {"distro": "humbel"}}, {"components": "none"}], ids=["refused", "unreadable"])
async def test_a_suspended_app_frees_its_devices_whatever_is_wrong_with_its_spec(
    world: ReconciledServer, spec: dict[str, Any]
) -> None:
    await world.pool()
    world.cache.nodes["amr-07"] = make_node("amr-07")
    driver_slice = {"metadata": {"name": "s"}, "spec": {"driver": "devices.robotics.io", "nodeName": "amr-07"}}
    world.cache.allocations.put_slice(msgspec.convert(driver_slice, ResourceSlice))
    lidar = {"name": "lidar", "type": "serial"}
    uid = await world.app(components=[{"name": "driver", "image": "x", "devices": [lidar]}])
    await world.children.reconcile(uid, "")
    await world.mirror()
    (claim,) = (await world.client.list(RESOURCECLAIMS, as_type=ResourceClaim)).items
    world.cache.allocations.put_claim(claim, before=None)
    labels = {Label.APP_UID.value: uid, Label.COMPONENT.value: "driver", Label.INSTANCE.value: ""}
    meta = {"name": "p", "namespace": "default", "uid": "p", "labels": labels}
    world.cache.pods.put(uid, "default/p", msgspec.convert({"metadata": meta, "spec": {"nodeName": "amr-07"}}, Pod))

    await world.edit("teleop", **spec)
    await world.children.reconcile(uid, "")
    await world.edit("teleop", suspend=True)
    await world.children.reconcile(uid, "")
    await world.mirror()
    await world.children.reconcile(uid, "")
    assert {item["spec"]["replicas"] for item in await world.deployments()} == {0}
    assert (await world.client.list(RESOURCECLAIMS)).items, "its pod is still there"
    world.cache.pods.drop(uid, "default/p")
    await world.children.reconcile(uid, "")
    assert (await world.client.list(RESOURCECLAIMS)).items == []
