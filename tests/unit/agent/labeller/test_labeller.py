"""The labeller against an API server that refuses, fails and loses nodes; the real one is in tests/live/agent."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, until

from robotapp_agent.labeller.labeller import MANAGER, Labeller
from robotapp_client import ApiClient
from robotapp_client.api.resources import NODES, NODETELEMETRIES
from robotapp_client.tools.event_recorder import EventRecorder

PREFIX = "hardware.robotics.io/"
ARM = {"id": "serial-arm", "type": "serial", "model": "arm-7", "present": True}
OF_ARM = {"serial": "arm-7", "serial-arm": "arm-7", "source": "telemetry"}


@dataclass
class Place:
    """Nodes and telemetry as an admin writes them."""

    api: FakeApiServer
    admin: ApiClient

    async def node(self, name: str, **labels: str) -> None:
        found = {f"{PREFIX}{key}": value for key, value in labels.items()}
        await self.admin.create(NODES, {"metadata": {"name": name, "labels": {"robotics.io/robot": name} | found}})

    async def report(self, name: str, *devices: dict[str, Any]) -> None:
        body = {"metadata": {"name": name}, "status": {"devices": list(devices)}}
        await self.admin.create(NODETELEMETRIES, {"metadata": {"name": name}})
        await self.admin.apply(NODETELEMETRIES, body, subresource="status")

    async def labels(self, name: str) -> dict[str, str]:
        stored = await self.admin.get(NODES, name)
        assert stored["metadata"]["labels"]["robotics.io/robot"] == name
        found = stored["metadata"]["labels"].items()
        return {key.removeprefix(PREFIX): value for key, value in found if key.startswith(PREFIX)}

    async def wait(self, name: str, expected: dict[str, str]) -> None:
        async with asyncio.timeout(60):
            while await self.labels(name) != expected:  # noqa: ASYNC110 - the server tells nobody
                await asyncio.sleep(0.01)

    def writes(self) -> int:
        return sum(method == "PATCH" and "/nodes/" in path and MANAGER in path for method, path in self.api.requests)


@pytest.fixture
async def place() -> AsyncIterator[Place]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="kubectl") as admin:
        yield Place(api, admin)


@contextlib.asynccontextmanager
async def labelling(place: Place, *, kept_s: float = 0.0) -> AsyncIterator[None]:
    async with client_for(place.api.endpoint, field_manager=MANAGER) as client:
        recorder = EventRecorder(client, controller=MANAGER, instance="test")  # not run: what it writes has a live test
        task = asyncio.create_task(Labeller(client, client, recorder=recorder, kept_s=kept_s).run())
        await until(lambda: place.api.watching >= 2)
        yield
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_node_gets_the_labels_of_its_devices_in_one_write_and_keeps_its_own(place: Place) -> None:
    await place.node("robot-1")
    await place.report("robot-1", ARM)
    async with labelling(place):
        await place.wait("robot-1", OF_ARM)
        await place.node("robot-2")
        await place.report("robot-2", ARM)
        await place.wait("robot-2", OF_ARM)
        assert place.writes() == 2


async def test_what_another_manager_set_stays_and_the_others_are_written(place: Place) -> None:
    await place.node("robot-1", serial="by-hand")
    await place.report("robot-1", ARM)
    async with labelling(place):
        await place.wait("robot-1", {**OF_ARM, "serial": "by-hand"})
        assert place.writes() == 2, "one that was refused, one without what belongs to somebody else"
        own = {"metadata": {"name": "robot-1", "labels": {f"{PREFIX}serial": None}}}
        await place.admin.patch(NODES, "robot-1", own)
        await place.wait("robot-1", OF_ARM)


async def test_a_node_without_telemetry_is_left_as_it_is(place: Place) -> None:
    await place.node("plain", gpu="by-hand")
    await place.node("bare")
    async with labelling(place):
        await until(lambda: place.writes() == 1, what="the write that removes what an earlier labeller may have left")
        assert await place.labels("plain") == {"gpu": "by-hand"}
        assert await place.labels("bare") == {}


async def test_telemetry_of_a_node_that_does_not_exist_writes_nothing_until_it_does(place: Place) -> None:
    await place.report("later", ARM)
    async with labelling(place):
        assert place.writes() == 0
        await place.node("later")
        await place.wait("later", OF_ARM)
