"""The objects of claims tests: the store of the fake API server, with clients whose requests pass gates.

The same protocol tests run on the real API server in tests/live/claims; this one allows thousands of runs.
"""

import asyncio
from collections.abc import Collection

from tests.support import apiserver
from tests.support.apiserver.memory import Gate, MemoryTransport, pass_at_once

from robotapp_client import ApiClient, Endpoint


async def _yield_to_others(_: float) -> None:
    await asyncio.sleep(0)


class Store(apiserver.Store):
    """All objects; `client()` makes a client whose requests pass a gate before and after they take effect."""

    def client(
        self, before: Gate = pass_at_once, after: Gate = pass_at_once, *, namespaces: Collection[str] | None = None
    ) -> ApiClient:
        """Returns a client that may list namespaced objects in `namespaces`; None is everywhere."""
        transport = MemoryTransport(self, before=before, after=after, namespaces=namespaces)
        return ApiClient(Endpoint("memory"), user_agent="test", transport=transport, sleep=_yield_to_others)
