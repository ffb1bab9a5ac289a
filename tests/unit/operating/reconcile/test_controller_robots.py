"""What a change of the nodes asks for, and what a fleet costs."""

from typing import Any

import pytest
from tests.support.factories import app_body, domain_claim, make_node, robots
from tests.unit.operating.controlling import StubbedController

from robotapp_api.model.names import API_VERSION, Label
from robotapp_claims.rules.objects import OwnerReference
from robotapp_operator.plan.spec.objects import Deployment, Meta
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key
from robotapp_operator.reconcile.controller import FIRST_OBJECT_S, ROBOTS_REST_S
from robotapp_operator.watch.out_of_sight import OutOfSight

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


@pytest.fixture
def world() -> StubbedController:
    return StubbedController()


async def planned(world: StubbedController, *names: str, **spec: Any) -> None:
    """An app with these robots whose work is done."""
    world.cache.update_app(app_body(robots=EACH, **spec))
    world.cache.nodes.update(robots(*names))
    await world.handle(Key(Work.APP, "uid-1"))
    world.due(60)


async def test_a_robot_that_comes_asks_for_its_own_instance_alone(world: StubbedController) -> None:
    await planned(world, *(f"r-{number}" for number in range(50)))
    world.cache.nodes.update(robots("new"))
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert world.due(ROBOTS_REST_S) == {
        Key(Work.CHILDREN, "uid-1", "new"),
        Key(Work.INSTANCE, "uid-1", "new"),
        Key(Work.STATUS, "uid-1"),
        Key(Work.FLEET, "ns/default"),
    }
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert world.due(60) == set()


async def test_a_robot_that_leaves_takes_its_instance_along_and_what_is_remembered_of_it(
    world: StubbedController,
) -> None:
    await planned(world, "a", "b")
    world.memory.of("uid-1").held["b"] = ("x",)
    del world.cache.nodes["n-b"]
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    found = world.due(FIRST_OBJECT_S)
    assert {Key(Work.CHILDREN, "uid-1", "b"), Key(Work.INSTANCE, "uid-1", "b")} <= found
    assert Key(Work.CHILDREN, "uid-1", "a") not in found
    assert world.memory.of("uid-1").held == {}


async def test_a_robot_out_of_sight_keeps_what_is_remembered_of_it_and_is_looked_at_when_its_grace_is_over(
    world: StubbedController,
) -> None:
    world.cache.sight = OutOfSight(world.clock)
    await planned(world, "a", "b")
    owner = OwnerReference(api_version=API_VERSION, kind="RobotApp", uid="uid-1", controller=True)
    meta = Meta(name="d", labels={Label.INSTANCE.value: "b"}, owner_references=(owner,))
    world.cache.deployments.put("uid-1", "default/d", Deployment(metadata=meta))
    world.cache.claims.put("uid-1", "c", domain_claim(7, instance="b"))
    world.memory.of("uid-1").held["b"] = ("x",)
    del world.cache.nodes["n-b"]
    robots_key = Key(Work.ROBOTS, "uid-1")
    await world.handle(robots_key)
    assert world.memory.of("uid-1").held == {"b": ("x",)}
    assert robots_key not in world.due(299)
    assert robots_key in world.due(1)
    await world.handle(robots_key)
    assert Key(Work.CHILDREN, "uid-1", "b") in world.due(ROBOTS_REST_S)
    assert world.memory.of("uid-1").held == {}


async def test_a_robot_that_gets_a_second_computer_is_another_instance_to_look_at(world: StubbedController) -> None:
    await planned(world, "a", "b")
    world.cache.nodes["second"] = make_node("second", robot="a")
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert Key(Work.CHILDREN, "uid-1", "a") in world.due()


@pytest.mark.parametrize("before", [("a",), ()])
async def test_an_app_that_is_accepted_or_refused_now_is_planned_anew(
    world: StubbedController, before: tuple[str, ...]
) -> None:
    await planned(world, *before)
    world.cache.nodes.clear()
    world.cache.nodes.update(robots(*({"a"} - set(before))))
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert world.due() == {Key(Work.APP, "uid-1")}


async def test_nodes_of_an_app_that_is_going_or_gone_are_nobodys_business(world: StubbedController) -> None:
    await world.handle(Key(Work.ROBOTS, "nobody"))
    assert len(world.memory) == 0
    body = app_body()
    body["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    world.cache.update_app(body)
    await world.handle(Key(Work.ROBOTS, "uid-1"))
    assert world.due(60) == set()


async def test_the_status_of_a_large_fleet_is_looked_at_less_often(world: StubbedController) -> None:
    await planned(world, *(f"r-{number}" for number in range(500)))
    await world.handle(Key(Work.STATUS, "uid-1"))
    world.queue.add(Key(Work.STATUS, "uid-1"))
    assert Key(Work.STATUS, "uid-1") not in world.due(0.4)
    assert Key(Work.STATUS, "uid-1") in world.due(0.2)
