"""ResourceSlices follow the devices, and come back when somebody removes them."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest
from tests.support.agent.dra import ADAPTER, NODE, can_bus, device
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from robotapp_agent.driver import publisher as module
from robotapp_agent.driver.publisher import SlicePublisher
from robotapp_agent.shell.own_node import OwnNode
from robotapp_claims.rules.identity import claim_name_device
from robotapp_client import ApiClient
from robotapp_client.api.resources import NODES, RESOURCESLICES, ROBOTCLAIMS

Json = dict[str, Any]


class Place:
    """The slices as the API server has them."""

    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.publisher = SlicePublisher(client, lambda: OwnNode(NODE, "uid-of-node"))

    async def slices(self) -> list[Json]:
        return sorted((await self.client.list(RESOURCESLICES)).items, key=lambda one: str(one["metadata"]["name"]))

    async def wait(self, condition: Callable[[list[Json]], bool]) -> list[Json]:
        async with asyncio.timeout(20):
            while not condition(slices := await self.slices()):  # noqa: ASYNC110 - the server tells nobody
                await asyncio.sleep(0.01)
        return slices

    async def wait_for(self, *ids: str) -> list[Json]:
        return await self.wait(
            lambda slices: (
                bool(slices) and [one["name"] for each in slices for one in each["spec"]["devices"]] == sorted(ids)
            )
        )

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[SlicePublisher]:
        task = asyncio.create_task(self.publisher.run())
        try:
            yield self.publisher
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


@pytest.fixture
async def place(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Place]:
    monkeypatch.setattr(module, "CHECK_S", 0.05)
    monkeypatch.setattr(module, "WITHHELD_S", 0.05)
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        api.store.put(NODES, {"metadata": {"name": NODE}})
        yield Place(api, client)


async def test_nothing_is_published_before_the_first_scan(place: Place) -> None:
    async with place.running() as publisher:
        publisher.publish_soon()
        await asyncio.sleep(0)
        assert place.api.requests == []
        publisher.update_devices([device()])
        await place.wait_for(ADAPTER)


async def test_slices_follow_the_devices_and_belong_to_the_node(place: Place) -> None:
    async with place.running() as publisher:
        publisher.update_devices([device()])
        (first,) = await place.wait_for(ADAPTER)
        publisher.update_devices([device(), can_bus()])
        (second,) = await place.wait_for("can-can0", ADAPTER)
    assert first["metadata"]["ownerReferences"][0]["uid"] == "uid-of-node"
    assert second["spec"]["pool"]["generation"] > first["spec"]["pool"]["generation"]


async def test_a_pool_that_shrinks_leaves_no_slice_behind(place: Place) -> None:
    many = [device(f"serial-{number:03}") for number in range(100)]
    async with place.running() as publisher:
        publisher.update_devices(many)
        await place.wait(lambda slices: len(slices) == 2)
        publisher.update_devices(many[:3])
        (one,) = await place.wait(lambda slices: len(slices) == 1)
        assert one["spec"]["pool"]["resourceSliceCount"] == 1


async def test_slices_that_somebody_removed_come_back(place: Place) -> None:
    async with place.running() as publisher:
        publisher.update_devices([device()])
        (one,) = await place.wait_for(ADAPTER)
        await place.client.delete(RESOURCESLICES, one["metadata"]["name"])
        await place.wait_for(ADAPTER)


async def test_unchanged_slices_are_read_and_not_written(place: Place) -> None:
    async with place.running() as publisher:
        publisher.update_devices([device()])
        await place.wait_for(ADAPTER)
        place.api.requests.clear()
        await place.wait(lambda _: sum(method == "GET" and NODE in path for method, path in place.api.requests) > 6)
    assert {method for method, _ in place.api.requests} == {"GET"}


async def test_devices_of_robotclaims_are_withheld_until_these_are_gone(place: Place) -> None:
    name = claim_name_device(NODE, ADAPTER)
    await place.client.create(ROBOTCLAIMS, {"metadata": {"name": name}, "spec": {}})
    async with place.running() as publisher:
        publisher.update_devices([device(), can_bus()])
        await place.wait_for("can-can0")
        await place.client.delete(ROBOTCLAIMS, name)
        await place.wait_for("can-can0", ADAPTER)
        # From now on the device is given out as a ResourceClaim; a RobotClaim is a mistake that must not take it back.
        await place.client.create(ROBOTCLAIMS, {"metadata": {"name": name}, "spec": {}})
        publisher.update_devices([device(), can_bus(), can_bus("can1")])
        await place.wait_for("can-can0", "can-can1", ADAPTER)


async def test_errors_of_the_api_server_are_outlived(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place.publisher, "_backoff", module.Backoff(base_s=0.01, cap_s=0.02))
    place.api.failing += [403, 500, 0, 409]
    async with place.running() as publisher:
        publisher.update_devices([device()])
        async with asyncio.timeout(20):
            while place.api.failing:  # noqa: ASYNC110 - the server tells nobody
                await asyncio.sleep(0.01)
        await place.wait_for(ADAPTER)


async def test_where_taints_are_dropped_lost_devices_are_left_out(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    create = ApiClient.create

    async def create_without_taints(client: ApiClient, resource: Any, obj: Json, **more: Any) -> Json:
        devices = [{k: v for k, v in one.items() if k != "taints"} for one in obj["spec"]["devices"]]
        return await create(client, resource, {**obj, "spec": {**obj["spec"], "devices": devices}}, **more)

    monkeypatch.setattr(ApiClient, "create", create_without_taints)
    async with place.running() as publisher:
        publisher.update_devices([device(present=False), can_bus()])
        await place.wait_for("can-can0")


async def test_a_node_that_was_made_again_gets_its_slices_again(place: Place) -> None:
    async with place.running() as publisher:
        publisher.update_devices([device()])
        await place.wait_for(ADAPTER)
    place.publisher = SlicePublisher(place.client, lambda: OwnNode(NODE, "uid-of-the-next-node"))
    async with place.running() as publisher:
        publisher.update_devices([device()])
        await place.wait(lambda s: bool(s) and s[0]["metadata"]["ownerReferences"][0]["uid"] == "uid-of-the-next-node")


async def test_a_runtime_that_would_leave_devices_out_gets_none(place: Place) -> None:
    def run_on(version: str) -> None:
        info = {"nodeInfo": {"containerRuntimeVersion": version}}
        place.api.store.put(NODES, {"metadata": {"name": NODE}, "status": info})

    run_on("containerd://1.6.20")
    async with place.running() as publisher:
        publisher.update_devices([device()])
        await place.wait_for()
        assert "1.6.20 reads no CDI specs" in publisher.runtime_problem
        run_on("containerd://2.2.9")
        await place.wait_for(ADAPTER)
        assert publisher.runtime_problem == ""
