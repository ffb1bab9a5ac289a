"""What a pass reads on demand is read once, however many claims ask for it at the same time."""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable

import pytest
from tests.support.sweep_world import World

from robotapp_api.claiming.sweep_snapshot import View, read_view


@pytest.mark.parametrize(
    ("ask", "reads"),
    [
        (View.usage_everywhere, {"list deployments": 1, "list replicasets": 1, "list pods": 1}),
        (View._robot_nodes, {"list nodes": 1}),
    ],
)
async def test_eight_claims_that_ask_for_one_list_read_it_once(
    ask: Callable[[View], Awaitable[object]], reads: dict[str, int]
) -> None:
    found: Counter[str] = Counter()

    async def gate(what: str) -> None:
        found[what] += 1
        await asyncio.sleep(0)

    view = await read_view(World().store.client(before=gate), ["team"])
    found.clear()
    await asyncio.gather(*(ask(view) for _ in range(8)))
    assert found == reads
