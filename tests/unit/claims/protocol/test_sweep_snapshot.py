"""What a pass reads on demand is read once, however many claims ask for it at the same time."""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable

import pytest
from msgspec import ValidationError
from tests.unit.claims.protocol.sweep_rig import SweepRig

from robotapp_claims.protocol.sweep_snapshot import APPS_BY_NAME, View, read_view
from robotapp_client.api.resources import ROBOTAPPS


@pytest.mark.parametrize(
    ("ask", "reads"),
    [
        (View.usage_everywhere, {"list deployments": 1, "list replicasets": 1, "list jobs": 1, "list pods": 1}),
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

    view = await read_view(SweepRig().store.client(before=gate), ["team"])
    found.clear()
    await asyncio.gather(*(ask(view) for _ in range(8)))
    assert found == reads


async def apps_of_many(*, refused: type[Exception] | None = None) -> tuple[list[str], Counter[str]]:
    """Which holders of 40 claims a pass finds gone, where one was deleted and one created anew, and its reads by verb."""
    reads: Counter[str] = Counter()

    async def gate(what: str) -> None:
        reads[what.split(maxsplit=1)[0]] += 1
        if refused is not None and what.startswith("list"):
            raise refused
        await asyncio.sleep(0)

    rig = SweepRig()
    holders = [rig.new_app(f"app-{number}") for number in range(40)]
    for name in ("app-7", "app-39"):
        rig.store.remove(ROBOTAPPS, name, "team")
    rig.new_app("app-39")
    view = await read_view(rig.store.client(), ["team"])
    view.client = rig.store.client(before=gate)
    found = await asyncio.gather(*map(view.app, holders))
    gone = [holder.name for holder, app in zip(holders, found, strict=True) if app is None]
    assert all(app is None or app.metadata.uid == holder.uid for holder, app in zip(holders, found, strict=True))
    return gone, reads


async def test_the_apps_of_many_claims_are_listed_once_and_a_few_are_read_by_name() -> None:
    gone, reads = await apps_of_many()
    assert gone == ["app-7", "app-39"]
    assert reads == {"get": APPS_BY_NAME, "list": 1}


async def test_an_app_that_cannot_be_decoded_holds_up_no_other_claim() -> None:
    gone, reads = await apps_of_many(refused=ValidationError)
    assert gone == ["app-7", "app-39"]
    assert reads == {"get": 40, "list": 1}
