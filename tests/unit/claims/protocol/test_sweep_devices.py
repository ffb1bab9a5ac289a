"""Devices are handed over or given back; bare pods hold what they were granted."""

import msgspec
import pytest
from tests.support.claims.objects import pod_holder, pod_json
from tests.unit.claims.protocol.sweep_rig import SweepRig, number

from robotapp_claims.protocol.domains import ensure_pod_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Pod
from robotapp_client.api.resources import (
    PODS,
    ROBOTCLAIMS,
)


async def test_a_device_waits_for_a_successor_which_takes_it_over() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="p1", uid=rig.app.uid))
    name = await rig.device(pod["metadata"]["uid"])
    await rig.sweep()
    assert rig.phase(name) == "Reserved"
    rig.store.remove(PODS, "p1", "team")
    await rig.sweep()
    assert rig.phase(name) == "Draining"
    await rig.device("successor")
    claim = rig.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    assert claim["status"] == {"phase": "Reserved", "attempt": 2, "pod": "successor", "node": "edge-1"}


async def test_a_device_nobody_comes_for_is_freed_after_the_handover() -> None:
    rig = SweepRig()
    name = await rig.device("gone")
    await rig.sweep()
    await rig.sweep(after_s=14)
    assert rig.phase(name) == "Draining"
    await rig.sweep(after_s=2)
    assert rig.phase(name) == "gone"


async def test_a_successor_that_waits_for_a_node_does_not_keep_the_device() -> None:
    rig = SweepRig()
    name = await rig.device("gone")
    rig.store.put(PODS, pod_json(name="p2", uid=rig.app.uid, node=""))
    await rig.sweep()
    await rig.sweep(after_s=16)
    assert rig.phase(name) == "gone"


async def test_a_device_of_a_deleted_or_suspended_app_is_freed_when_its_pod_is_gone_and_not_before() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="p1", uid=rig.app.uid))
    name = await rig.device(pod["metadata"]["uid"])
    rig.delete_app()
    await rig.sweep()
    assert rig.phase(name) == "Reserved"
    rig.store.remove(PODS, "p1", "team")
    await rig.sweep()
    assert rig.phase(name) == "gone"


@pytest.mark.parametrize("namespace", ["a\nb", "team/pods/p1?x=", "..", "é\u202e", "Team"])
@pytest.mark.parametrize("kind", ["RobotApp", "Pod"])
async def test_a_holder_in_what_is_no_namespace_is_gone_and_its_claim_is_freed(namespace: str, kind: str) -> None:
    """Found by random claims: each pass ended in a traceback for it, and the thing was never free again."""
    rig = SweepRig()
    name = await rig.device("gone")
    claim = rig.store.find(ROBOTCLAIMS, name)
    assert claim is not None
    claim["spec"]["holder"] |= {"namespace": namespace, "kind": kind}
    rig.store.put(ROBOTCLAIMS, claim)
    await rig.sweep()
    await rig.sweep(after_s=100)
    assert rig.phase(name) == "gone"
    assert not rig.sweeper.counts["failed claims"]


async def test_a_pod_that_lost_its_labels_but_still_runs_keeps_its_device() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="p1", node="edge-1"))
    name = await rig.device(pod["metadata"]["uid"])
    await rig.sweep()
    assert rig.phase(name) == "Reserved"


async def test_a_pod_bound_without_the_device_gives_it_back() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="p1", uid=rig.app.uid, node="edge-2", phase="Running"))
    name = await rig.device(pod["metadata"]["uid"])
    await rig.sweep()
    assert rig.phase(name) == "gone"


# Bare pods


async def test_a_bare_pods_domain_rests_and_its_device_is_free_at_once() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="bare"))
    holder = pod_holder(pod["metadata"]["uid"], "bare")
    domain = (await ensure_pod_domain(rig.store.client(), DomainRequest(holder))).claim
    device = await rig.device(holder.uid, holder)
    await rig.sweep()
    assert (rig.phase(domain), rig.phase(device)) == ("Reserved", "Reserved")
    rig.store.remove(PODS, "bare", "team")
    await rig.sweep()
    assert (rig.phase(domain), rig.phase(device)) == ("Draining", "gone")
    await rig.sweep(after_s=61)
    assert rig.phase(domain) == "gone"


async def test_claims_of_a_bare_pod_that_a_cache_shows_cost_no_request_and_what_it_shows_too_long_goes_a_pass_later() -> (
    None
):
    rig, asked = SweepRig(), list[str]()
    pod = rig.store.put(PODS, pod_json(name="bare"))
    holder = pod_holder(pod["metadata"]["uid"], "bare")
    domain = (await ensure_pod_domain(rig.store.client(), DomainRequest(holder))).claim
    device = await rig.device(holder.uid, holder)
    grants = {"granted.robotics.io/dds-domain": str(number(domain)), "granted.robotics.io/devices": "can-can0"}
    bound = pod_json(name="bare", node="edge-1", phase="Running", annotations=grants)
    cache = [msgspec.convert(rig.store.put(PODS, bound), Pod)]

    async def note(what: str) -> None:
        asked.append(what)

    rig.sweeper = Sweeper(
        rig.store.client(before=note), clock=lambda: rig.now, granted_pods=lambda: cache, pending_s=60
    )
    await rig.sweep()
    assert "get pods bare" not in asked
    rig.store.remove(PODS, "bare", "team")
    await rig.sweep()
    assert (rig.phase(domain), rig.phase(device)) == ("Reserved", "Reserved")
    cache.clear()
    await rig.sweep()
    assert (rig.phase(domain), rig.phase(device)) == ("Draining", "gone")
    rig.store.put(PODS, bound, uid=holder.uid)
    cache.append(msgspec.convert(rig.store.find(PODS, "bare", "team"), Pod))
    await rig.sweep()
    assert rig.phase(domain) == "Reserved", "what is used again is taken back, whatever the cache shows"


async def test_a_cached_pod_that_was_bound_without_the_thing_does_not_keep_it() -> None:
    rig = SweepRig()
    pod = rig.store.put(PODS, pod_json(name="bare", node="edge-1", phase="Running"))
    device = await rig.device(pod["metadata"]["uid"], pod_holder(pod["metadata"]["uid"], "bare"))
    rig.sweeper = rig.another(granted_pods=lambda: [msgspec.convert(pod, Pod)])
    await rig.sweep()
    assert rig.phase(device) == "gone"
