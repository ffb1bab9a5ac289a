"""The API server of the unit tests keeps the promises clients rely on."""

import asyncio
import json
import time

import pytest
from tests.support.apiserver import FakeApiServer, Key
from tests.support.clients import client_for, configmap, until

from robotapp_client.api.resources import CONFIGMAPS

BOOKMARK_S = 0.005


def _hold_up_the_loop() -> None:
    """Busy machines do: the next bookmark is due in the very round in which the loop goes on."""
    time.sleep(2 * BOOKMARK_S)


@pytest.mark.parametrize("rounds", range(8))
async def test_no_bookmark_overtakes_a_change(rounds: int) -> None:
    """Else a client whose watch ends between the two resumes behind a change it never saw."""
    async with FakeApiServer(bookmark_s=BOOKMARK_S) as api, client_for(api.endpoint) as client:
        path = f"{CONFIGMAPS.path()}?watch=1&allowWatchBookmarks=true&resourceVersion={api.store.version}"
        async with client.stream(path, silence_s=5.0) as stream:
            pieces: list[bytes] = []
            reading = asyncio.create_task(stream.deliver(pieces.extend))
            await until(lambda: b"BOOKMARK" in b"".join(pieces), what="a bookmark")
            _hold_up_the_loop()
            for _ in range(rounds):
                await asyncio.sleep(0)
            api.store.create(Key("/configmaps", "default", "a"), configmap("a"))
            await until(lambda: b"ADDED" in b"".join(pieces), what="the change")
            api.end_watches()
            await reading
    events = [json.loads(line) for line in b"".join(pieces).splitlines()]
    before = events[: [event["type"] for event in events].index("ADDED")]
    assert {event["object"]["metadata"]["resourceVersion"] for event in before} == {"1"}
