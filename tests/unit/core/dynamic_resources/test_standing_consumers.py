"""The allocation of a RobotApp's claim is kept between its pods, and given back when the app needs it no longer."""

from datetime import UTC, datetime
from typing import Any

import msgspec
import pytest
from tests.support.scheduler.devices import allocated_on, claim

from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.dynamic_resources.standing_consumers import find_release_reason, is_standing

NOW = datetime(2026, 1, 1, 12, 0, 0, tzinfo=UTC)
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


def release(claim: ResourceClaim, of_app: RobotApp | None, now: datetime, *, nodes: tuple[str, ...] = ("n1",)) -> str:
    return find_release_reason(claim, of_app, now, exists=nodes.__contains__)


def app(uid: str = "uid-app", *, devices: Any = DEVICES, name: str = "driver", **fields: Any) -> RobotApp:
    metadata = {"name": "patrol", "namespace": "default", "uid": uid, **fields.pop("metadata", {})}
    spec = {"components": [{"name": name, "devices": devices}], **fields}
    return msgspec.convert({"metadata": metadata, "spec": spec}, RobotApp)


def test_an_allocation_is_kept_while_the_app_wants_it() -> None:
    assert is_standing(held())
    assert release(held(), app(), NOW) == ""


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
        (held(annotations={"robotics.io/release": "instance suspended"}), app(), "instance suspended"),
        (
            held(annotations={"robotics.io/refused-since": "2026-01-01T11:59:30Z"}),
            app(),
            "the driver has refused the claim for 30 s",
        ),
    ],
)
def test_it_is_given_back_with_the_reason(found: ResourceClaim, of_app: RobotApp | None, reason: str) -> None:
    assert release(found, of_app, NOW) == reason
    users = (POD_USER, APP_USER)
    with_pod = msgspec.structs.replace(found, status=held(*users).status)
    assert release(with_pod, of_app, NOW) == "", "a device is not taken from a container"


@pytest.mark.parametrize("text", ["2026-01-01T11:59:31Z", "soon", "", "2026-01-01", "2026-01-01T00:00:00"])
def test_a_refusal_that_is_younger_or_no_time_changes_nothing(text: str) -> None:
    assert release(held(annotations={"robotics.io/refused-since": text}), app(), NOW) == ""


def test_claims_of_others_are_left_alone() -> None:
    foreign = claim("mine", allocated_on("n1"), reservedFor=[APP_USER])
    assert release(foreign, None, NOW) == "", "its owner is no RobotApp"
    unused = claim("patrol-driver", allocated_on("n1"), ownerReferences=[OWNER])
    assert release(unused, None, NOW) == "", "allocated by another scheduler, which gives it back itself"
    waiting = claim("patrol-driver", ownerReferences=[OWNER])
    assert release(waiting, None, NOW) == ""


def test_a_node_that_is_gone_for_good_holds_nobody() -> None:
    assert release(held(), app(), NOW, nodes=("n2",)) == "node n1 is gone"
    everywhere = claim("patrol-driver", allocated_on(), reservedFor=[APP_USER], ownerReferences=[OWNER])
    assert release(everywhere, app(), NOW, nodes=()) == ""
