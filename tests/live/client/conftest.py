"""The same tests on the real API server and on the one made for unit tests, which they keep honest."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from robotapp_client import ApiClient, load


@dataclass(frozen=True)
class Place:
    """A server, a client on it and a namespace of its own."""

    client: ApiClient
    namespace: str
    fake: FakeApiServer | None = None


@asynccontextmanager
async def open_place(request: pytest.FixtureRequest) -> AsyncIterator[Place]:
    if request.param == "fake":
        async with FakeApiServer(bookmark_s=0.1) as api, client_for(api.endpoint) as client:
            yield Place(client, "robots", api)
        return
    plane = request.getfixturevalue("control_plane")
    namespace = request.getfixturevalue("namespace")
    async with client_for(load(plane.kubeconfig("admin")), timeout_s=20) as client:
        yield Place(client, namespace)


@pytest.fixture(params=["fake", pytest.param("real", marks=pytest.mark.live)])
async def place(request: pytest.FixtureRequest) -> AsyncIterator[Place]:
    async with open_place(request) as opened:
        yield opened
