"""F4 on the real API server, with the scheduler's rights: fence, then release."""

from datetime import UTC, datetime

import msgspec
import pytest
from tests.support.clients import FakeTime

from campaigns.rigs.claims_live import Live
from robotapp_claims.protocol.devices import reserve_devices
from robotapp_claims.protocol.release import give_back
from robotapp_claims.protocol.sweeper import PENDING_S
from robotapp_claims.rules.device import chosen
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import Conflict

pytestmark = pytest.mark.live


async def test_a_waiting_pod_gives_back_what_it_has_in_vain_and_a_bind_decided_before_is_refused(place: Live) -> None:
    mine, other = await place.make_app("mine"), await place.make_app("other")
    devices = [
        chosen(node=place.node, device_id=name, device_type="can", identity="") for name in ("can-a", "can-can0")
    ]
    rival = await place.make_pod("rival", other.holder)
    assert (await place.reserve(rival["metadata"]["uid"], place.driver(other))).ok
    body = await place.make_pod("waits", mine.holder)
    found = await reserve_devices(
        place.scheduler,
        holder=place.driver(mine),
        pod_uid=body["metadata"]["uid"],
        node=place.node,
        devices=devices,
    )
    assert [claim.spec.device.id for claim in found.in_vain if claim.spec.device] == ["can-a"]
    assert await give_back(place.scheduler, msgspec.convert(body, Pod), found.in_vain) == 1
    held = {claim.spec.device.id: claim.holder.name for claim in await place.claims() if claim.spec.device}
    assert held == {"can-can0": "other"}
    binding = {
        "apiVersion": "v1",
        "kind": "Binding",
        "metadata": {
            "name": "waits",
            "uid": body["metadata"]["uid"],
            "resourceVersion": body["metadata"]["resourceVersion"],
        },
        "target": {"kind": "Node", "name": place.node},
    }
    with pytest.raises(Conflict):
        await place.scheduler.post_raw(PODS.path(place.namespace, "waits", "binding"), msgspec.json.encode(binding))
    stored = await place.admin.get(PODS, "waits", namespace=place.namespace)
    (condition,) = [item for item in stored["status"]["conditions"] if item["type"] == "PodScheduled"]
    assert condition["status"] == "False"


async def test_a_pod_tried_twice_in_a_second_gives_back_each_time_and_still_shows_why_it_waits(place: Live) -> None:
    request = await place.make_app()
    body = await place.make_pod("waits", request.holder)
    told = {
        "type": "PodScheduled",
        "status": "False",
        "reason": "DeviceBusy",
        "message": "lidar is held by another pod",
    }
    await place.scheduler.patch(
        PODS,
        "waits",
        {"status": {"conditions": [told]}},
        namespace=place.namespace,
        subresource="status",
        content_type=STRATEGIC,
    )
    moment = datetime.now(UTC)
    for _ in range(3):
        assert (await place.reserve(body["metadata"]["uid"], place.driver(request))).ok
        pod = await place.admin.get(PODS, "waits", namespace=place.namespace, as_type=Pod)
        assert await give_back(place.scheduler, pod, await place.claims(), now=lambda: moment) == 1
        assert await place.claims() == []
    stored = await place.admin.get(PODS, "waits", namespace=place.namespace)
    (condition,) = [item for item in stored["status"]["conditions"] if item["type"] == "PodScheduled"]
    assert {key: condition[key] for key in told} == told


async def test_the_schedulers_sweep_takes_a_device_from_a_pod_nobody_tries_to_place(place: Live) -> None:
    request = await place.make_app()
    pod = await place.make_pod("waits", request.holder)
    assert (await place.reserve(pod["metadata"]["uid"], place.driver(request))).ok
    (claim,) = await place.claims()
    rest = FakeTime()
    sweeper = place.sweeper(place.scheduler, pending_s=PENDING_S, clock=rest.clock)
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "Reserved"
    rest.now_s += PENDING_S + 0.1
    await sweeper.sweep_once()
    assert await place.phase(claim.name) == "gone"
