"""Devices are handed over or given back; bare pods hold what they were granted."""

import msgspec
import pytest
from tests.support.claims.objects import pod_holder, pod_json
from tests.support.claims.sweep_world import World, number

from robotapp_claims.protocol.domains import ensure_pod_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.resources import (
    PODS,
    ROBOTCLAIMS,
)


async def test_a_device_waits_for_a_successor_which_takes_it_over() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "Reserved"
    world.store.remove(PODS, "p1", "team")
    await world.sweep()
    assert world.phase(name) == "Draining"
    await world.device("successor")
    claim = world.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["status"] == {"phase": "Reserved", "attempt": 2, "pod": "successor", "node": "edge-1"}


async def test_a_device_nobody_comes_for_is_freed_after_the_handover() -> None:
    world = World()
    name = await world.device("gone")
    await world.sweep()
    await world.sweep(after_s=14)
    assert world.phase(name) == "Draining"
    await world.sweep(after_s=2)
    assert world.phase(name) == "gone"


async def test_a_device_of_a_deleted_or_suspended_app_is_freed_when_its_pod_is_gone_and_not_before() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid))
    name = await world.device(pod["metadata"]["uid"])
    world.delete_app()
    await world.sweep()
    assert world.phase(name) == "Reserved"
    world.store.remove(PODS, "p1", "team")
    await world.sweep()
    assert world.phase(name) == "gone"


@pytest.mark.parametrize("namespace", ["a\nb", "team/pods/p1?x=", "..", "é\u202e", "Team"])
@pytest.mark.parametrize("kind", ["RobotApp", "Pod"])
async def test_a_holder_in_what_is_no_namespace_is_gone_and_its_claim_is_freed(namespace: str, kind: str) -> None:
    """Found by random claims: each pass ended in a traceback for it, and the thing was never free again."""
    world = World()
    name = await world.device("gone")
    claim = world.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    claim["spec"]["holder"] |= {"namespace": namespace, "kind": kind}
    world.store.put(ROBOTCLAIMS, claim)
    await world.sweep()
    await world.sweep(after_s=100)
    assert world.phase(name) == "gone"
    assert not world.sweeper.counts["failed claims"]


async def test_a_pod_that_lost_its_labels_but_still_runs_keeps_its_device() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", node="edge-1"))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "Reserved"


async def test_a_pod_bound_without_the_device_gives_it_back() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="p1", uid=world.app.uid, node="edge-2", phase="Running"))
    name = await world.device(pod["metadata"]["uid"])
    await world.sweep()
    assert world.phase(name) == "gone"


# Bare pods


async def test_a_bare_pods_domain_rests_and_its_device_is_free_at_once() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="bare"))
    holder = pod_holder(pod["metadata"]["uid"], "bare")
    domain = (await ensure_pod_domain(world.store.client(), DomainRequest(holder))).claim
    device = await world.device(holder.uid, holder)
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Reserved", "Reserved")
    world.store.remove(PODS, "bare", "team")
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Draining", "gone")
    await world.sweep(after_s=61)
    assert world.phase(domain) == "gone"


async def test_claims_of_a_bare_pod_that_a_cache_shows_cost_no_request_and_what_it_shows_too_long_goes_a_pass_later() -> (
    None
):
    world, asked = World(), list[str]()
    pod = world.store.put(PODS, pod_json(name="bare"))
    holder = pod_holder(pod["metadata"]["uid"], "bare")
    domain = (await ensure_pod_domain(world.store.client(), DomainRequest(holder))).claim
    device = await world.device(holder.uid, holder)
    grants = {"granted.robotics.io/dds-domain": str(number(domain)), "granted.robotics.io/devices": "can-can0"}
    bound = pod_json(name="bare", node="edge-1", phase="Running", annotations=grants)
    cache = [msgspec.convert(world.store.put(PODS, bound), Pod)]

    async def note(what: str) -> None:
        asked.append(what)

    world.sweeper = Sweeper(
        world.store.client(before=note), clock=lambda: world.now, granted_pods=lambda: cache, pending_s=60
    )
    await world.sweep()
    assert "get pods bare" not in asked
    world.store.remove(PODS, "bare", "team")
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Reserved", "Reserved")
    cache.clear()
    await world.sweep()
    assert (world.phase(domain), world.phase(device)) == ("Draining", "gone")
    world.store.put(PODS, bound, uid=holder.uid)
    cache.append(msgspec.convert(world.store.find(PODS, "bare", "team"), Pod))
    await world.sweep()
    assert world.phase(domain) == "Reserved", "what is used again is taken back, whatever the cache shows"


async def test_a_cached_pod_that_was_bound_without_the_thing_does_not_keep_it() -> None:
    world = World()
    pod = world.store.put(PODS, pod_json(name="bare", node="edge-1", phase="Running"))
    device = await world.device(pod["metadata"]["uid"], pod_holder(pod["metadata"]["uid"], "bare"))
    world.sweeper = world.another(granted_pods=lambda: [msgspec.convert(pod, Pod)])
    await world.sweep()
    assert world.phase(device) == "gone"
