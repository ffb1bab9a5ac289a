"""The allocation of a RobotApp's claim is kept between its pods, and given back when the app needs it no longer."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduler.devices import allocated_on, claim

from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.dynamic_resources.standing_consumers import (
    explain_predecessor,
    find_release_reason,
    find_standing_app,
    is_standing,
    list_next_users,
    list_predecessors,
)

OWNER = {
    "apiVersion": "robotics.io/v1alpha1",
    "kind": "RobotApp",
    "name": "patrol",
    "uid": "uid-app",
    "controller": True,
}
APP_USER = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "patrol", "uid": "uid-app"}
POD_USER = {"resource": "pods", "name": "p", "uid": "uid-p"}
DEVICES = [{"name": "camera", "type": "camera"}]


def held(*users: dict[str, str], **metadata: Any) -> ResourceClaim:
    metadata = {"ownerReferences": [OWNER], "labels": {"robotics.io/component": "driver"}, **metadata}
    return claim("patrol-driver", allocated_on("n1"), reservedFor=list(users or [APP_USER]), **metadata)


def release(claim: ResourceClaim, of_app: RobotApp | None, *, nodes: tuple[str, ...] = ("n1",)) -> str:
    return find_release_reason(claim, of_app, exists=nodes.__contains__)


def app(uid: str = "uid-app", *, devices: Any = DEVICES, name: str = "driver", **fields: Any) -> RobotApp:
    metadata = {"name": "patrol", "namespace": "default", "uid": uid, **fields.pop("metadata", {})}
    spec = {"components": [{"name": name, "devices": devices}], **fields}
    return msgspec.convert({"metadata": metadata, "spec": spec}, RobotApp)


def test_an_allocation_is_kept_while_the_app_wants_it() -> None:
    assert is_standing(held())
    assert release(held(), app()) == ""


@pytest.mark.parametrize(
    ("found", "of_app", "reason"),
    [
        (held(), None, "RobotApp patrol is gone"),
        (held(), app("uid-of-another"), "RobotApp patrol is gone"),
        (held(), app(metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"}), "RobotApp patrol is being deleted"),
        (held(), app(suspend=True), "RobotApp patrol is suspended"),
        (held(), app(name="planner"), "component driver is no longer part of the app"),
        (held(), app(devices=[]), "component driver requests no device any more"),
        (held(deletionTimestamp="2026-01-01T00:00:00Z"), app(), "the claim is being deleted"),
    ],
)
def test_it_is_given_back_with_the_reason(found: ResourceClaim, of_app: RobotApp | None, reason: str) -> None:
    assert release(found, of_app) == reason
    users = (POD_USER, APP_USER)
    with_pod = msgspec.structs.replace(found, status=held(*users).status)
    assert release(with_pod, of_app) == "", "a device is not taken from a container"


def test_the_next_pod_waits_for_those_before_it_and_other_claims_are_shared() -> None:
    (predecessor,) = list_predecessors(held(POD_USER, APP_USER), "uid-q")
    assert explain_predecessor(held(), predecessor) == 'resourceclaim "patrol-driver" is still used by pod "p"'
    assert list_predecessors(held(POD_USER, APP_USER), "uid-p") == ()
    assert list_predecessors(held(POD_USER), "uid-q") == (), "allocated by another scheduler, which shares"
    assert list_predecessors(claim("mine", allocated_on("n1"), reservedFor=[POD_USER]), "uid-q") == ()


def test_a_pod_is_entered_in_the_place_of_those_before_it_and_with_the_app_when_it_is_allocated() -> None:
    def users(found: ResourceClaim, *, allocates: bool) -> list[str]:
        return [user.uid for user in list_next_users(found, name="q", uid="uid-q", allocates=allocates)]

    assert users(held(POD_USER, APP_USER), allocates=False) == ["uid-app", "uid-q"]
    assert users(held(POD_USER), allocates=False) == ["uid-p", "uid-q"], "allocated by another scheduler, which shares"
    assert users(claim("patrol-driver", ownerReferences=[OWNER]), allocates=True) == ["uid-q", "uid-app"]
    assert users(claim("mine"), allocates=True) == ["uid-q"]


def test_claims_of_others_are_left_alone() -> None:
    foreign = claim("mine", allocated_on("n1"), reservedFor=[APP_USER], ownerReferences=[{**OWNER, "kind": "Robot"}])
    assert release(foreign, None) == "", "its owner is no RobotApp"
    unused = claim("patrol-driver", allocated_on("n1"), ownerReferences=[OWNER])
    assert release(unused, None) == "", "allocated by another scheduler, which gives it back itself"
    waiting = claim("patrol-driver", ownerReferences=[OWNER])
    assert release(waiting, None) == ""


def test_an_orphan_keeps_its_device_as_long_as_the_app_that_was_its_owner_or_a_pod() -> None:
    orphan = held(ownerReferences=[])
    assert find_standing_app(orphan) == ("patrol", "uid-app")
    assert release(orphan, app()) == ""
    assert release(orphan, None) == "RobotApp patrol is gone"
    assert release(held(POD_USER, APP_USER, ownerReferences=[]), None) == ""
    assert find_standing_app(claim("mine", allocated_on("n1"), reservedFor=[POD_USER])) is None


def test_a_node_that_is_gone_for_good_holds_nobody() -> None:
    assert release(held(), app(), nodes=("n2",)) == "node n1 is gone"
    everywhere = claim("patrol-driver", allocated_on(), reservedFor=[APP_USER], ownerReferences=[OWNER])
    assert release(everywhere, app(), nodes=()) == ""
