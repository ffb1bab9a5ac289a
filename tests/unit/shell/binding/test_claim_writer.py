"""Resource claims are written in upstream's order, each state at most once, whatever is lost on the way."""

import copy
from datetime import UTC, datetime
from typing import Any

import msgspec
import pytest
from tests.support.scheduler.devices import allocated_on, claim, wanting
from tests.support.scheduling import make_info

from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import Conflict, Forbidden, NotFound, ServerError, Unreachable
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import ClaimPlan, PlannedClaim
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    DeviceAllocationConfiguration,
    OpaqueDeviceConfiguration,
    ResourceClaim,
)
from robotapp_scheduler.core.events.change_log import ChangeLog
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.shell.binding.claim_writer import DEPOSED, FINALIZER, TRIES, ClaimWriter

NOW = "2026-01-01T00:00:00Z"
OTHER = {"resource": "pods", "name": "other", "uid": "uid-other"}
SELF = {"resource": "pods", "name": "p", "uid": "uid-p"}
APP = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "patrol", "uid": "uid-app", "controller": True}
STANDING = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "patrol", "uid": "uid-app"}
ALLOCATION = msgspec.convert(allocated_on("n1"), AllocationResult)


class Server:
    """Stores claims as the API server does: one writer per version. `failures` are raised before (or after) writes in turn."""

    def __init__(self, *claims: ResourceClaim) -> None:
        self.stored: dict[str, Any] = {each.metadata.name: msgspec.to_builtins(each) for each in claims}
        self.writes: list[tuple[str, dict[str, Any]]] = []
        self.failures: list[tuple[Exception, bool] | None] = []
        """(error, whether the write takes effect all the same), None for a write that succeeds."""
        self.slept: list[float] = []
        self.pods: dict[str, Pod] = {}

    async def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)

    async def get(self, resource: Any, name: str, **_: Any) -> Any:
        if resource is PODS:
            if name not in self.pods:
                raise NotFound(f'pods "{name}" not found', status=404, reason="NotFound")
            return self.pods[name]
        if name not in self.stored:
            raise NotFound(f'resourceclaims "{name}" not found', status=404)
        return msgspec.convert(self.stored[name], ResourceClaim)

    async def patch(self, _resource: Any, name: str, patch: Any, *, subresource: str = "", **_: Any) -> Any:
        failure = self.failures.pop(0) if self.failures else None
        if failure is not None and not failure[1]:
            raise failure[0]
        reply = self._apply(name, patch, subresource)
        if failure is not None:
            raise failure[0]
        return reply

    def _apply(self, name: str, patch: Any, subresource: str) -> Any:
        stored = self.stored[name]
        if isinstance(patch, list):
            version, status = (operation["value"] for operation in patch)
            patch = {"metadata": {"uid": stored["metadata"]["uid"], "resourceVersion": version}, "status": status}
        version = patch["metadata"].pop("resourceVersion", None)
        if version is not None and version != stored["metadata"]["resourceVersion"]:
            raise Conflict("the object has been modified", status=409)
        assert patch["metadata"].pop("uid") == stored["metadata"]["uid"]
        self.writes.append((subresource, copy.deepcopy(patch)))
        stored["metadata"] |= patch["metadata"]
        for key, value in patch.get("status", {}).items():
            stored.setdefault("status", {})[key] = value
        stored["metadata"]["resourceVersion"] = str(int(stored["metadata"]["resourceVersion"]) + 1)
        return copy.deepcopy(stored)


class World:
    def __init__(self, *claims: ResourceClaim, stored: ResourceClaim | None = None) -> None:
        """`stored` is newer than what the watch has shown."""
        self.server = Server(*(claims if stored is None else (stored,)))
        self.cache = ClaimCache(ChangeLog, lambda _: None, lambda _: False)
        for each in claims:
            self.cache.apply_claim(each)
        self.events: list[Event] = []
        self.retried: list[str] = []
        self.leads = True
        self.writer = ClaimWriter(
            self.server,  # type: ignore[arg-type]
            self.cache,
            permitted=lambda: self.leads,
            now=lambda: datetime(2026, 1, 1, tzinfo=UTC),
            on_change=self.events.append,
            retry=self.retried.append,
        )

    async def bind(self, allocation: AllocationResult | None = ALLOCATION) -> str:
        found = self.cache.get("default", "camera")
        assert found is not None
        return await self.writer.bind(wanting("camera"), ClaimPlan((PlannedClaim(found, allocation),)))

    @property
    def status(self) -> dict[str, Any]:
        status: dict[str, Any] = self.server.stored["camera"]["status"]
        return status


async def test_a_new_allocation_is_written_after_the_finalizer_with_its_first_user_and_counts_at_once() -> None:
    world = World(claim("camera", finalizers=["example.com/mine"]))
    assert await world.bind() == ""
    first, second = world.server.writes
    assert first == ("", {"metadata": {"finalizers": ["example.com/mine", FINALIZER]}})
    allocation = {**allocated_on("n1"), "allocationTimestamp": NOW}
    assert second == ("status", {"metadata": {}, "status": {"reservedFor": [SELF], "allocation": allocation}})
    known = world.cache.get("default", "camera")
    assert known is not None
    assert known.status.allocation is not None
    assert [event.resource for event in world.events] == ["resourceclaims"], "pods that share it are waiting for this"


async def test_a_claim_of_a_robotapp_gets_no_finalizer_and_the_app_as_second_user() -> None:
    world = World(claim("camera", ownerReferences=[APP]))
    assert await world.bind() == ""
    assert [subresource for subresource, _ in world.server.writes] == ["status"]
    assert world.status["reservedFor"] == [SELF, STANDING]


async def test_later_users_of_an_allocated_claim_are_added_beside_the_others_and_once() -> None:
    world = World(claim("camera", allocated_on("n1"), reservedFor=[STANDING], ownerReferences=[APP]))
    assert await world.bind(None) == ""
    assert world.status["reservedFor"] == [STANDING, SELF]
    assert await world.bind(None) == ""
    assert len(world.server.writes) == 1


async def test_the_next_pod_of_a_robotapp_takes_the_place_of_those_that_are_gone_in_the_same_write() -> None:
    world = World(claim("camera", allocated_on("n1"), reservedFor=[OTHER, STANDING], ownerReferences=[APP]))
    assert await world.bind(None) == ""
    assert world.server.writes == [("status", {"metadata": {}, "status": {"reservedFor": [STANDING, SELF]}})]


@pytest.mark.parametrize(
    ("uid", "phase", "is_gone"),
    [("uid-other", "Running", False), ("uid-other", "Failed", True), ("uid-of-a-namesake", "Running", True)],
)
async def test_a_pod_does_not_join_a_claim_of_a_robotapp_beside_another_one(
    uid: str, phase: str, is_gone: bool
) -> None:
    world = World(claim("camera", allocated_on("n1"), reservedFor=[OTHER, STANDING], ownerReferences=[APP]))
    pod = {"metadata": {"name": "other", "uid": uid}, "status": {"phase": phase}}
    world.server.pods["other"] = msgspec.convert(pod, Pod)
    trouble = await world.bind(None)
    assert trouble == ("" if is_gone else 'resourceclaim "camera" is still used by pod "other"')
    assert len(world.server.writes) == is_gone


async def test_what_others_wrote_meanwhile_is_kept() -> None:
    world = World(
        claim("camera", allocated_on("n1")),
        stored=claim("camera", allocated_on("n1"), version="8", reservedFor=[OTHER]),
    )
    assert await world.bind(None) == ""
    assert world.status["reservedFor"] == [OTHER, SELF]


@pytest.mark.parametrize("error", [Unreachable("reset", maybe_applied=True), ServerError("timeout", status=504)])
@pytest.mark.parametrize("lost", [0, 1])
@pytest.mark.parametrize("applied", [True, False])
async def test_a_write_whose_reply_got_lost_is_made_exactly_once(error: Exception, lost: int, applied: bool) -> None:
    world = World(claim("camera"))
    world.server.failures = [None] * lost + [(error, applied)]
    assert await world.bind() == ""
    assert [subresource for subresource, _ in world.server.writes] == ["", "status"]
    assert world.status["reservedFor"] == [SELF]
    assert world.server.slept


@pytest.mark.parametrize(
    ("stored", "text"),
    [
        (claim("camera", allocated_on("n2"), version="8"), "claim default/camera got allocated elsewhere in the meantime"),
        (claim("camera", version="8", deletionTimestamp=NOW), "claim default/camera got deleted in the meantime"),
        (claim("camera", version="8", uid="another"), "claim default/camera got deleted in the meantime"),
        (claim("arm", version="8"), "get updated claim default/camera after conflict: "),
    ],
)  # fmt: skip
async def test_a_claim_that_changed_since_the_decision_sends_the_pod_back(stored: ResourceClaim, text: str) -> None:
    world = World(claim("camera"), stored=stored)
    if stored.metadata.name == "arm":
        world.server.failures = [(Conflict("changed", status=409), False)]
    assert (await world.bind()).startswith(text)
    assert world.server.writes == []


async def test_a_refusal_and_a_claim_that_never_stands_still_are_named() -> None:
    world = World(claim("camera"))
    world.server.failures = [(Forbidden("not allowed", status=403), False)]
    assert await world.bind() == "add allocation and reservation to claim default/camera: not allowed"
    world.server.failures = [(Conflict("changed", status=409), False)] * TRIES
    assert await world.bind() == "add allocation and reservation to claim default/camera: changed"
    world = World(claim("camera", allocated_on("n1")))
    world.server.failures = [(Forbidden("full", status=403), False)]
    assert await world.bind(None) == "add reservation to claim default/camera: full"


async def test_an_allocation_whose_parameters_are_nested_too_deep_is_refused_with_the_cure() -> None:
    nested: dict[str, Any] = {}
    for _ in range(5000):
        nested = {"a": nested}
    opaque = OpaqueDeviceConfiguration(driver="x", parameters=nested)
    devices = msgspec.structs.replace(ALLOCATION.devices, config=(DeviceAllocationConfiguration(opaque=opaque),))
    world = World(claim("camera"))
    text = await world.bind(msgspec.structs.replace(ALLOCATION, devices=devices))
    assert text == "parameters of a driver in claim default/camera are nested too deep: write them flatter"
    assert "allocation" not in world.status


async def test_without_the_lease_nothing_is_written() -> None:
    world = World(claim("camera"))
    world.leads = False
    assert await world.bind() == DEPOSED
    assert world.server.writes == []


async def test_a_pod_that_was_not_bound_leaves_the_users_and_its_allocation_stays() -> None:
    world = World(claim("camera"))
    assert await world.bind() == ""
    found = world.cache.get("default", "camera")
    assert found is not None
    await world.writer.release(wanting("camera"), ClaimPlan((PlannedClaim(found, None),)))
    (_, patch) = world.server.writes[-1]
    assert patch["status"] == {"reservedFor": [{"$patch": "delete", "uid": "uid-p"}]}
    await world.writer.release(make_info("q"), ClaimPlan((PlannedClaim(found, None),)))
    assert len(world.server.writes) == 3, "q was no user"


async def test_a_claim_that_changed_is_read_before_a_pod_leaves_it_and_a_deposed_leader_takes_nobody_off() -> None:
    before = claim("camera", allocated_on("n1"), reservedFor=[SELF])
    plan = ClaimPlan((PlannedClaim(before, None),))
    world = World(before, stored=claim("camera", allocated_on("n1"), version="8", reservedFor=[SELF, OTHER]))
    await world.writer.release(wanting("camera"), plan)
    assert len(world.server.writes) == 1
    world = World(before, stored=claim("camera", allocated_on("n1"), version="8", reservedFor=[OTHER]))
    await world.writer.release(wanting("camera"), plan)
    assert world.server.writes == []
    world = World(before)
    world.server.failures = [(Conflict("changed", status=409), False)]
    world.leads = False
    await world.writer.release(wanting("camera"), plan)
    assert world.server.writes == []


async def test_an_allocation_is_taken_back_for_the_version_that_was_seen_or_the_pod_is_tried_again() -> None:
    world = World(claim("camera", allocated_on("gone")))
    found = world.cache.get("default", "camera")
    assert found is not None
    world.writer.deallocate(found, wanting("camera"))
    await world.writer.drain(1)
    assert world.status == {"allocation": None, "reservedFor": None, "devices": None}
    world = World(claim("camera", allocated_on("gone")))
    world.server.failures = [(Forbidden("not allowed", status=403), False)]
    world.writer.deallocate(found, wanting("camera"))
    await world.writer.drain(1)
    assert world.retried == ["uid-p"]
