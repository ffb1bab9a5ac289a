"""Two users of one thing: both apps say so, and nobody is robbed."""

from collections.abc import AsyncIterator

import pytest

from campaigns.rigs.claims_live import Live, live, until
from robotapp_client.api.resources import EVENTS, ROBOTAPPS
from robotapp_testbed import ControlPlane

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("operator")]


@pytest.fixture
async def place(installed_plane: ControlPlane, namespace: str) -> AsyncIterator[Live]:
    async with live(installed_plane, namespace) as found:
        await found.make_pool()
        yield found


async def test_two_apps_with_one_device_both_say_so_until_one_gives_way(place: Live) -> None:
    holds, runs = await place.make_app("holds"), await place.make_app("runs")
    holder = await place.make_pod("holder", holds.holder)
    assert (await place.reserve(holder["metadata"]["uid"], place.driver(holds))).ok
    pod = await place.make_pod("runner", runs.holder)
    await place.bind(place.scheduler, pod, annotations={"granted.robotics.io/devices": "can-can0"})

    async def reason(name: str) -> str:
        app = await place.admin.get(ROBOTAPPS, name, namespace=place.namespace)
        return next(item["reason"] for item in app["status"]["conditions"] if item["type"] == "Allocated")

    async def both_say_so() -> bool:
        return {await reason("holds"), await reason("runs")} == {"ClaimConflict"}

    async def told() -> set[str]:
        found = (await place.admin.list(EVENTS, namespace=place.namespace)).items
        return {event["regarding"]["name"] for event in found if event["reason"] == "ClaimConflict"}

    async def both_told() -> bool:
        return await told() == {"holds", "runs"}

    await until(both_say_so)
    await until(both_told)
    (claim,) = [claim for claim in await place.claims() if claim.spec.device]
    assert claim.holder.name == "holds"
    await place.delete_pod("runner")

    async def over() -> bool:
        return "ClaimConflict" not in {await reason("holds"), await reason("runs")}

    await until(over)
