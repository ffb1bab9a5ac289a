"""A device of a RobotApp is given back for an app as it is, not as it was: the app is read after its claim."""

from typing import Any

import pytest
from tests.support.scheduler.devices import allocated_on, claim
from tests.support.scheduling import app_object, make_cluster, make_node

from robotapp_client.transport.errors import NotFound
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.shell.binding.standing_claims import StandingClaims

OWNER = {
    "apiVersion": "robotics.io/v1alpha1",
    "kind": "RobotApp",
    "name": "patrol",
    "uid": "uid-app",
    "controller": True,
}
STANDING = {"apiGroup": "robotics.io", "resource": "robotapps", "name": "patrol", "uid": "uid-app"}
GONE = NotFound('robotapps.robotics.io "patrol" not found', status=404, reason="NotFound")


def patrol(**spec: Any) -> RobotApp:
    return app_object({"name": "driver", "devices": [{"name": "eye"}]}, name="patrol", uid="uid-app", **spec)


def held(component: str = "driver") -> ResourceClaim:
    labels = {"robotics.io/component": component}
    return claim("camera", allocated_on("n1"), reservedFor=[STANDING], ownerReferences=[OWNER], labels=labels)


class World:
    """`cached` is what the watch has shown of the app, `live` the API server's answer."""

    def __init__(self, cached: RobotApp | None, live: RobotApp | Exception) -> None:
        self.live = live
        self.freed: list[ResourceClaim] = []
        cache = make_cluster(make_node("n1"))
        if cached is not None:
            cache.apply_app(cached)
        self.standing_claims = StandingClaims(self, cache, self)  # type: ignore[arg-type]

    async def get(self, *_: Any, **__: Any) -> RobotApp:
        if isinstance(self.live, Exception):
            raise self.live
        return self.live

    async def free(self, claim: ResourceClaim) -> None:
        self.freed.append(claim)


@pytest.mark.parametrize(
    ("cached", "live", "is_freed"),
    [
        (patrol(suspend=True), patrol(suspend=True), True),
        (patrol(suspend=True), patrol(), False),
        (patrol(), patrol(suspend=True), False),
        (patrol(suspend=True), GONE, True),
        (None, GONE, True),
        (None, patrol(), False),
        (None, NotFound("404 page not found", status=404), False),
    ],
    ids=["suspended", "resumed", "not seen yet", "deleted", "gone", "new", "a proxy's answer"],
)
async def test_a_device_is_given_back_for_the_app_as_it_is_now(
    cached: RobotApp | None, live: RobotApp | Exception, is_freed: bool
) -> None:
    world = World(cached, live)
    await world.standing_claims.review(held())
    assert world.freed == [held()] * is_freed


async def test_an_orphan_whose_app_is_gone_gives_its_device_back() -> None:
    orphan = claim("camera", allocated_on("n1"), reservedFor=[STANDING])
    world = World(None, GONE)
    await world.standing_claims.review(orphan)
    assert world.freed == [orphan]


async def test_a_replica_with_an_ordinal_keeps_its_device_and_one_too_many_gives_it_back() -> None:
    component = {"name": "driver", "devices": [{"name": "eye"}], "replicas": 2, "replicaIdentity": "Ordinal"}
    app = app_object(component, name="patrol", uid="uid-app")
    world = World(app, app)
    await world.standing_claims.review(held("driver-1"))
    assert world.freed == []
    await world.standing_claims.review(held("driver-2"))
    assert world.freed == [held("driver-2")]
