"""The same tests on the real API server and on the one made for unit tests."""

import asyncio
import contextlib
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from robotapp_agent.report.clock_offset import ClockOffset
from robotapp_agent.shell.api_writer import ApiWriter
from robotapp_agent.shell.own_node import OwnNode
from robotapp_client import ApiClient, load
from robotapp_client.api.resources import NODES, NODETELEMETRIES
from robotapp_client.transport.errors import NotFound


@dataclass
class Robot:
    """A node of its own on a server, and the writer of its agent."""

    client: ApiClient
    real: bool
    name: str = field(default_factory=lambda: f"robot-{secrets.token_hex(3)}")
    uid: str = ""
    offset: ClockOffset = field(default_factory=ClockOffset)

    def __post_init__(self) -> None:
        self.writer = ApiWriter(self.client, lambda: OwnNode(self.name, self.uid), offset=self.offset)

    async def appear(self) -> None:
        """The Node object, made anew."""
        with contextlib.suppress(NotFound):
            await self.client.delete(NODES, self.name)
        node = await self.client.create(NODES, {"metadata": {"name": self.name}})
        self.uid = node["metadata"]["uid"]

    async def telemetry(self) -> dict[str, Any]:
        return await self.client.get(NODETELEMETRIES, self.name)

    async def gone(self) -> None:
        """The garbage collector has removed the telemetry; the fake has none."""
        if not self.real:
            await self.client.delete(NODETELEMETRIES, self.name)
        async with asyncio.timeout(120):
            while True:
                try:
                    await self.telemetry()
                except NotFound:
                    return
                await asyncio.sleep(0.05)


@pytest.fixture(params=["fake", pytest.param("real", marks=pytest.mark.live)])
async def robot(request: pytest.FixtureRequest) -> AsyncIterator[Robot]:
    if request.param == "fake":
        async with FakeApiServer() as api, client_for(api.endpoint) as client:
            found = Robot(client, real=False)
            await found.appear()
            yield found
        return
    plane = request.getfixturevalue("installed_plane")
    async with client_for(load(plane.kubeconfig("admin")), timeout_s=20) as client:
        found = Robot(client, real=True)
        await found.appear()
        yield found
        for resource in (NODES, NODETELEMETRIES):
            try:
                await client.delete(resource, found.name)
            except NotFound:
                continue
