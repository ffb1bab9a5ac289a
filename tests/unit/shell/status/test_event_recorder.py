"""Who is told of a thing with two users."""

import asyncio
from collections.abc import AsyncIterator

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from robotapp_claims.rules.identity import holder_of_app, holder_of_pod
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_client import ApiClient
from robotapp_client.api.resources import EVENTS
from robotapp_scheduler.shell.status.event_recorder import PodEvents


@pytest.fixture
async def client() -> AsyncIterator[ApiClient]:
    async with FakeApiServer() as api, client_for(api.endpoint) as found:
        yield found


async def test_bare_pods_are_told_of_a_conflict_and_apps_are_left_to_the_operator(client: ApiClient) -> None:
    pod = holder_of_pod(namespace="team", name="bare", uid="uid-3")
    app = holder_of_app(namespace="other", name="teleop", uid="uid-1")
    events = PodEvents(client, ["ros-aware-scheduler"], host="h")
    for runs, holds in ((pod, app), (app, pod)):
        events.conflicts([ClaimConflict(runs=runs, holds=holds, claim="dds.default.c.7", thing="domain 7 of default")])
    writing = asyncio.create_task(events.run())
    await events.drain()
    writing.cancel()
    stored = (await client.list(EVENTS)).items
    assert {event["regarding"]["name"] for event in stored} == {"bare"}
    assert sorted(event["note"] for event in stored) == [
        "domain 7 of default is held by another namespace, but pod team/bare runs with it: delete the pods of one of them",
        "domain 7 of default is held by pod team/bare, but another namespace runs with it: delete the pods of one of them",
    ]
