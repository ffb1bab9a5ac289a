"""Devices count as taken from the decision on, until the claim has them or the pod gives them back; nothing is counted twice."""

from collections.abc import Collection
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduler.devices import DRIVER, allocated_on, claim, device_class, resource_slice, wanting

from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan, PlannedClaim
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    DeviceClaimConfiguration,
    DeviceId,
    OpaqueDeviceConfiguration,
)
from robotapp_scheduler.core.events.change_log import EVERY_ROW, ChangeLog
from robotapp_scheduler.core.events.cluster_event import Change

ROWS = {"n1": 0, "n2": 1}
NEWS = Change.RESOURCE_CLAIMS


def make_cache(pods: Collection[str] = ()) -> tuple[ClaimCache, ChangeLog]:
    """pods: uids of those that exist."""
    log = ChangeLog()
    cache = ClaimCache(lambda: log, ROWS.get, pods.__contains__)
    for node in ROWS:
        cache.apply_slice(resource_slice(node, "d0", "d1"))
    return cache, log


def plan(name: str, node: str, device: str = "d0") -> ClaimPlan:
    allocation = msgspec.convert(allocated_on(node, device=device), AllocationResult)
    return ClaimPlan((PlannedClaim(claim(name), allocation),))


def taken(cache: ClaimCache) -> set[tuple[str, str]]:
    return {(device.pool, device.device) for device in cache.allocated}


def test_a_decision_counts_until_its_write_is_answered_and_the_claim_from_then_on() -> None:
    cache, log = make_cache()
    cache.apply_claim(claim("camera"))
    position = log.position
    cache.assume("uid-p", plan("camera", "n2"))
    assert taken(cache) == {("n2", "d0")}
    assert log.since(position, int(NEWS), most=10) == [1], "only the row of the node whose device it is"
    written = claim("camera", allocated_on("n2"), version="9")
    assert cache.record_write(written) is NEWS
    assert cache.forget("uid-p") is NEWS
    assert taken(cache) == {("n2", "d0")}
    assert cache.apply_claim(claim("camera", version="7")) is Change.NONE, "an event from before the write"
    assert taken(cache) == {("n2", "d0")}
    assert cache.apply_claim(written) is Change.NONE
    assert cache.apply_claim(claim("camera", version="12")) is NEWS
    assert taken(cache) == set()


def test_parameters_as_deep_as_the_decoder_goes_concern_their_own_claim_alone() -> None:
    """They are encoded with less of the stack left, in the same turn as the claims of other tenants."""
    cache, _ = make_cache()
    for name in ("deep", "also-deep"):
        deep = claim(name)
        opaque = OpaqueDeviceConfiguration(driver=DRIVER, parameters=nest(5000))
        devices = msgspec.structs.replace(deep.spec.devices, config=(DeviceClaimConfiguration(opaque=opaque),))
        cache.apply_claim(msgspec.structs.replace(deep, spec=msgspec.structs.replace(deep.spec, devices=devices)))
    found = [cache.resolve(wanting(name).pod) for name in ("deep", "also-deep")]
    assert [claims.trouble for claims in found] == ["", ""]
    assert found[0].key != found[1].key


def nest(levels: int) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for _ in range(levels):
        nested = {"a": nested}
    return nested


def test_pods_of_a_group_share_an_allocation_that_is_not_written_yet_and_others_wait() -> None:
    cache, _ = make_cache()
    cache.apply_claim(claim("camera"))
    cache.assume("uid-p", plan("camera", "n1"), group="patrol")
    pod = wanting("camera", name="q").pod
    (state,) = cache.resolve(pod, "patrol").states
    assert state.pending is not None
    (state,) = cache.resolve(pod, "another").states
    assert state.pending is None
    (state,) = cache.resolve(pod).states
    assert state.pending is None
    assert cache.is_in_flight(state.claim)
    cache.assume("uid-q", plan("camera", "n1"), group="patrol")
    assert cache.forget("uid-p") is Change.NONE
    assert taken(cache) == {("n1", "d0")}
    assert cache.forget("uid-q") is NEWS
    assert taken(cache) == set()


def test_a_reply_about_a_claim_that_was_made_anew_meanwhile_changes_nothing() -> None:
    cache, _ = make_cache()
    cache.apply_claim(claim("camera", uid="new", version="20"))
    assert cache.record_write(claim("camera", allocated_on("n1"), version="25", uid="old")) is Change.NONE
    assert taken(cache) == set()


def test_a_device_of_two_claims_is_free_when_both_are_gone() -> None:
    cache, _ = make_cache()
    for name in ("one", "two"):  # by two schedulers: the API server takes both
        cache.apply_claim(claim(name, allocated_on("n1")))
    cache.remove_claim(claim("one"))
    assert taken(cache) == {("n1", "d0")}
    cache.remove_claim(claim("two"))
    assert taken(cache) == set()


def test_claims_with_equal_requests_have_equal_keys_and_results_are_kept_per_node() -> None:
    cache, log = make_cache()
    for name in ("one", "two"):
        cache.apply_claim(claim(name))
    cache.apply_claim(claim("three", of_class="robots"))
    keys = [cache.resolve(wanting(name).pod).key for name in ("one", "two", "three")]
    assert keys[0] == keys[1] != keys[2]
    before = [cache.get_revision(node) for node in ("n1", "n2")]
    cache.assume("uid-p", plan("one", "n2"))
    assert [cache.get_revision(node) == old for node, old in zip(("n1", "n2"), before, strict=True)] == [True, False]
    position = log.position
    cache.apply_class(device_class("robots"))
    assert cache.get_revision("n1") != before[0]
    assert log.delta(position, most=5).rows(int(Change.DEVICE_CLASSES)) is None  # type: ignore[union-attr]  # it is there
    assert EVERY_ROW == -1


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["assume", "forget", "written", "seen", "removed"]),
        st.integers(0, 3),
        st.sampled_from(["n1", "n2"]),
        st.sampled_from(["d0", "d1"]),
    ),
    max_size=30,
)


@given(STEPS)
def test_whatever_happens_exactly_the_devices_of_claims_and_open_decisions_are_taken(
    steps: list[tuple[str, int, str, str]],
) -> None:
    cache, _ = make_cache()
    claims: dict[int, DeviceId | None] = {}
    decided: dict[int, DeviceId] = {}
    version = 10
    for step, number, node, device in steps:
        version += 1
        name, uid, wanted = f"c{number}", f"uid-p{number}", DeviceId(DRIVER, node, device)
        if step == "assume" and number not in decided:
            cache.assume(uid, plan(name, node, device))
            decided[number] = wanted
        elif step == "forget":
            cache.forget(uid)
            decided.pop(number, None)
        elif step == "written":
            if number in claims:
                cache.record_write(claim(name, allocated_on(node, device=device), version=str(version)))
                claims[number] = wanted
        elif step == "seen":
            cache.apply_claim(claim(name, version=str(version)))
            claims[number] = None
        else:
            cache.remove_claim(claim(name))
            claims.pop(number, None)
        expected = {found for found in claims.values() if found is not None} | set(decided.values())
        assert set(cache.allocated) == expected


APP = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "patrol", "uid": "uid-app", "controller": True}
STANDING = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "patrol", "uid": "uid-app"}
FIRST = {"resource": "pods", "name": "first", "uid": "uid-first"}


def test_the_next_pod_of_a_robotapp_waits_for_the_one_before_and_a_pod_that_shares_does_not() -> None:
    pods = {"uid-first", "uid-next"}
    cache, _ = make_cache(pods)
    cache.apply_claim(claim("camera", allocated_on("n1"), ownerReferences=[APP], reservedFor=[STANDING, FIRST]))
    cache.apply_claim(claim("shared", allocated_on("n1", device="d1"), reservedFor=[FIRST]))
    assert (
        cache.resolve(wanting("camera", name="next").pod).trouble
        == 'resourceclaim "camera" is still used by pod "first"'
    )
    assert cache.resolve(wanting("camera", name="first").pod).trouble == ""
    assert cache.resolve(wanting("shared", name="next").pod).trouble == ""
    pods.remove("uid-first")
    assert cache.remove_pod(wanting("camera", name="first").pod) is NEWS, "the next one is to be tried"
    assert cache.remove_pod(wanting("shared", name="first").pod) is Change.NONE
    assert cache.resolve(wanting("camera", name="next").pod).trouble == "", "whether or not it is listed still"


@pytest.mark.parametrize("is_replaced", [True, False])
def test_devices_of_a_claim_that_was_deleted_below_its_pod_are_taken_until_the_pod_is_gone(is_replaced: bool) -> None:
    pods = {"uid-first"}
    cache, log = make_cache(pods)
    camera = claim("camera", allocated_on("n2"), ownerReferences=[APP], reservedFor=[STANDING, FIRST])
    cache.apply_claim(camera)
    if is_replaced:
        cache.apply_claim(claim("camera", version="8", uid="uid-of-the-next"))
    else:
        cache.remove_claim(camera)
    assert taken(cache) == {("n2", "d0")}
    position = log.position
    pods.remove("uid-first")
    assert cache.remove_pod(wanting("camera", name="first").pod) == NEWS | Change.RESOURCE_SLICES
    assert taken(cache) == set()
    assert log.since(position, int(NEWS), most=10) == [1]


def test_devices_of_a_deleted_claim_without_a_living_pod_are_free_at_once() -> None:
    cache, _ = make_cache()
    camera = claim("camera", allocated_on("n2"), ownerReferences=[APP], reservedFor=[STANDING, FIRST])
    cache.apply_claim(camera)
    cache.remove_claim(camera)
    assert taken(cache) == set()
