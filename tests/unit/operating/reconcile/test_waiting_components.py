"""Components that wait for others, and apps without ROS, against an API server."""

from collections.abc import AsyncIterator

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import component, make_pod
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Label
from robotapp_client.api.resources import DEPLOYMENTS
from robotapp_operator.plan.spec.objects import ReplicaSet


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield ReconciledServer(api, client)


async def test_a_component_that_waits_for_another_is_created_when_that_one_is_ready(world: ReconciledServer) -> None:
    await world.pool()
    uid = await world.app(components=[component("driver"), component("mapper", dependsOn=[{"component": "driver"}])])

    async def reconciled() -> list[str]:
        assert await world.children.reconcile(uid, "")
        await world.mirror()
        return sorted(item["metadata"]["labels"][Label.COMPONENT] for item in await world.deployments())

    assert await reconciled() == ["driver"]
    assert await reconciled() == ["driver"]
    (driver,) = await world.deployments()
    status = {"observedGeneration": 1, "replicas": 1, "updatedReplicas": 1, "readyReplicas": 1}
    await world.client.patch(DEPLOYMENTS, driver["metadata"]["name"], {"status": status}, namespace="default")
    assert await reconciled() == ["driver"], "the status counts pods that there are no longer"
    meta = {"name": "rs", "uid": "rs", "ownerReferences": [{"uid": driver["metadata"]["uid"], "controller": True}]}
    world.cache.put_replica_set(msgspec.convert({"metadata": meta}, ReplicaSet))
    owners = [{"uid": "rs", "controller": True}]
    ready = {"conditions": [{"type": "Ready", "status": "True"}]}
    world.cache.pods.put(
        uid,
        "p",
        make_pod("p", node="n", metadata={"ownerReferences": owners, "labels": {Label.INSTANCE: ""}}, status=ready),
    )
    assert await reconciled() == ["driver", "mapper"]
    world.api.requests.clear()
    ended = {"status": {**status, "readyReplicas": 0}}
    await world.client.patch(DEPLOYMENTS, driver["metadata"]["name"], ended, namespace="default")
    await world.mirror()
    assert await reconciled() == ["driver", "mapper"]
    assert world.writes() == 1, "the test's own"


async def test_an_app_without_ros_takes_no_domain(world: ReconciledServer) -> None:
    uid = await world.app(ros={"distro": "none"}, ros2=None)
    assert await world.children.reconcile(uid, "")
    assert await world.claims() == []
    assert len(await world.deployments()) == 2
