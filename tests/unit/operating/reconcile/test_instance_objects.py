"""One RobotAppInstance per instance: created, told what is observed, deleted, and deleted when it is a wrong one."""

import json
from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.apiserver.store import Key as Stored
from tests.support.clients import client_for
from tests.support.factories import app_body, component, domain_claim, make_app, make_node, robots, telemetry
from tests.unit.operating.controlling import place
from tests.unit.operating.instance_writing import REFUSED, WrittenInstances

from robotapp_client import NotFound
from robotapp_client.api.resources import ROBOTAPPINSTANCES, ROBOTAPPS
from robotapp_operator.plan.render.instance_object import object_name, wanted_object
from robotapp_operator.plan.status.latency import REST_S
from robotapp_operator.plan.status.pace import MOST_START_REST_S, SETTLED_S, STILL_S, URGENT_REST_S
from robotapp_operator.reconcile.reconcile_state import RACE_S

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
QUIET_S = 120.0


@pytest.fixture
async def world() -> AsyncIterator[WrittenInstances]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield WrittenInstances(api, client)


def ready_of(item: dict[str, Any]) -> tuple[str, str]:
    (found,) = [each for each in item["status"]["conditions"] if each["type"] == "Ready"]
    return found["status"], found["reason"]


async def test_an_instance_gets_its_object_and_then_what_is_observed(world: WrittenInstances) -> None:
    uid = await world.app()
    assert await world.objects.publish(uid, "") == 0.0
    (item,) = await world.stored()
    assert item["spec"] == {"app": "teleop", "appUID": uid, "instance": "", "robot": ""}
    assert item["metadata"]["name"] == object_name("teleop", "")
    assert await world.objects.publish(uid, "") == STILL_S, "it merely starts"
    world.now_s += STILL_S
    await world.objects.publish(uid, "")
    (item,) = await world.stored()
    assert item["status"]["summary"]["ready"] == "0/2"
    assert world.writes() == 3, "the app, the object, its status"


async def test_where_many_apps_start_an_instance_shows_later_how_far_it_has_come(world: WrittenInstances) -> None:
    uid = await world.app()
    for number in range(300):
        world.memory.crowd.note(f"other-{number}", starts=True, begins=True, now_s=world.now_s)
    await world.objects.publish(uid, "")
    assert await world.objects.publish(uid, "") == MOST_START_REST_S


async def test_at_rest_nothing_is_written(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.settle(uid)
    before = world.writes()
    world.now_s += 3600
    await world.mirror()
    assert await world.objects.publish(uid, "") is None
    world.cache.touch(uid, "")
    assert await world.objects.publish(uid, "") is None
    assert world.writes() == before


async def test_a_failure_is_told_after_a_moment(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.objects.publish(uid, "")
    world.now_s += QUIET_S
    world.refuse(uid)
    assert await world.objects.publish(uid, "") == pytest.approx(SETTLED_S)
    world.now_s += SETTLED_S
    await world.objects.publish(uid, "")
    (item,) = await world.stored()
    assert ready_of(item) == ("False", "DomainExhausted")


async def test_what_is_over_again_at_once_is_never_told(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.settle(uid)
    before = world.writes()
    world.now_s += QUIET_S
    world.refuse(uid)
    assert await world.objects.publish(uid, "") is not None
    del world.memory.of(uid).outcomes[""]
    world.now_s += SETTLED_S
    assert await world.objects.publish(uid, "") is None
    assert world.writes() == before


async def test_two_urgent_news_are_a_second_apart(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.objects.publish(uid, "")
    world.refuse(uid)
    assert await world.objects.publish(uid, "") == pytest.approx(URGENT_REST_S)


async def test_who_deletes_an_object_gets_it_back(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.settle(uid)
    (first,) = await world.stored()
    await world.client.delete(ROBOTAPPINSTANCES, first["metadata"]["name"], namespace="default")
    await world.settle(uid)
    (second,) = await world.stored()
    assert second["metadata"]["uid"] != first["metadata"]["uid"]
    assert second["status"] == first["status"]


async def test_an_object_that_is_back_although_its_end_was_announced_is_looked_for_without_haste(
    world: WrittenInstances,
) -> None:
    """An etcd restored from a snapshot has it again, with the same uid."""
    uid = await world.app()
    await world.settle(uid)
    (item,) = world.cache.instance_object_named.values()
    world.cache.drop_instance_object(item)
    assert await world.objects.publish(uid, "") == RACE_S
    world.cache.forget_ends()
    assert await world.objects.publish(uid, "") == 0.0
    assert world.cache.instance_object_named


async def test_an_object_that_went_with_its_app_does_not_come_back(world: WrittenInstances) -> None:
    """The event of the object came before that of its app."""
    uid = await world.app()
    await world.settle(uid)
    (item,) = await world.stored()
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    await world.client.delete(ROBOTAPPINSTANCES, item["metadata"]["name"], namespace="default")
    await world.settle(uid)
    assert await world.stored() == []


async def test_an_app_that_is_being_deleted_gets_no_object(world: WrittenInstances) -> None:
    body = app_body()
    body["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    world.cache.update_app(body)
    assert await world.objects.publish("uid-1", "") is None
    assert await world.stored() == []


async def test_an_app_this_version_cannot_read_gets_none(world: WrittenInstances) -> None:
    uid = await world.app(components="none")
    assert await world.objects.publish(uid, "") is None
    assert await world.stored() == []


async def test_a_robot_that_leaves_takes_its_object_along(world: WrittenInstances) -> None:
    world.cache.nodes.update(robots("a", "b"))
    uid = await world.app(robots=EACH)
    for robot in ("a", "b"):
        await world.settle(uid, robot)
    assert {item["spec"]["robot"] for item in await world.stored()} == {"a", "b"}
    del world.cache.nodes["n-b"]
    for robot in ("a", "b"):
        await world.settle(uid, robot)
    assert {item["spec"]["robot"] for item in await world.stored()} == {"a"}


async def test_an_app_that_is_created_anew_gets_objects_of_its_own(world: WrittenInstances) -> None:
    old = await world.app()
    await world.settle(old)
    await world.client.delete(ROBOTAPPS, "teleop", namespace="default")
    world.cache.forget_app(old)
    new = await world.app()
    await world.settle(new)
    (item,) = await world.stored()
    assert item["spec"]["appUID"] == new


@pytest.mark.parametrize(
    "wrong",
    [
        {"spec": {"app": "teleop", "appUID": "another", "instance": "", "robot": ""}},
        {"spec": {"app": "other", "appUID": "other", "instance": "x", "robot": "x"}},
        {"spec": {"app": "teleop", "appUID": "{uid}", "instance": "", "robot": "amr-07"}},
        {"metadata": {"ownerReferences": []}},
        {"metadata": {"labels": {}}},
    ],
    ids=["of another app", "of an unknown app", "of another robot", "without an owner", "without labels"],
)
async def test_a_wrong_object_under_the_name_is_deleted_and_made_anew(
    world: WrittenInstances, wrong: dict[str, Any]
) -> None:
    uid = await world.app()
    body = wanted_object(make_app(uid=uid), "")
    body["metadata"] |= wrong.get("metadata", {})
    body["spec"] = wrong.get("spec", body["spec"])
    body["spec"]["appUID"] = body["spec"]["appUID"].replace("{uid}", uid)
    forged = await world.client.create(ROBOTAPPINSTANCES, body)
    await world.settle(uid)
    (item,) = await world.stored()
    assert item["metadata"]["uid"] != forged["metadata"]["uid"]
    assert item["spec"] == {"app": "teleop", "appUID": uid, "instance": "", "robot": ""}


async def test_an_object_under_another_name_is_deleted(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.settle(uid)
    body = wanted_object(make_app(uid=uid), "")
    body["metadata"]["name"] = "copy"
    await world.client.create(ROBOTAPPINSTANCES, body)
    await world.settle(uid)
    assert [item["metadata"]["name"] for item in await world.stored()] == [object_name("teleop", "")]


async def test_an_orphan_is_swept_and_one_of_an_app_not_yet_announced_is_not(world: WrittenInstances) -> None:
    await world.client.create(ROBOTAPPINSTANCES, wanted_object(make_app(name="gone", uid="uid-gone"), ""))
    early = await world.app("early")
    await world.client.create(ROBOTAPPINSTANCES, wanted_object(make_app(name="early", uid=early), ""))
    world.cache.forget_app(early)
    await world.mirror()
    for uid in ("uid-gone", early):
        assert await world.objects.publish(uid, "") is None
    assert [item["spec"]["app"] for item in await world.stored()] == ["early"]


async def test_a_404_that_does_not_name_the_app_makes_no_orphan(
    world: WrittenInstances, monkeypatch: pytest.MonkeyPatch
) -> None:
    await world.client.create(ROBOTAPPINSTANCES, wanted_object(make_app(uid="uid-9"), ""))
    await world.mirror()

    async def not_served(*_: Any, **__: Any) -> Any:
        raise NotFound("the server could not find the requested resource", status=404)

    monkeypatch.setattr(world.client, "get", not_served)
    with pytest.raises(NotFound):
        await world.objects.publish("uid-9", "")
    assert len(await world.stored()) == 1


async def test_an_object_the_cache_does_not_know_yet_is_taken_over_not_created_twice(world: WrittenInstances) -> None:
    uid = await world.app()
    first = await world.client.create(ROBOTAPPINSTANCES, wanted_object(make_app(uid=uid), ""))
    assert await world.objects.publish(uid, "") == 0.0
    await world.settle(uid)
    (item,) = await world.stored()
    assert item["metadata"]["uid"] == first["metadata"]["uid"]


async def test_a_name_that_is_taken_for_a_moment_is_tried_again(
    world: WrittenInstances, monkeypatch: pytest.MonkeyPatch
) -> None:
    uid = await world.app()
    await world.client.create(ROBOTAPPINSTANCES, wanted_object(make_app(uid=uid), ""))

    async def gone(*_: Any, **__: Any) -> Any:
        raise NotFound("gone", status=404)

    monkeypatch.setattr(world.client, "get", gone)
    assert await world.objects.publish(uid, "") == RACE_S


async def test_an_object_that_only_the_cache_still_has_is_made_again(world: WrittenInstances) -> None:
    """Its DELETED event came before the answer to our own write, which put it back into the cache for good."""
    uid = await world.app()
    await world.objects.publish(uid, "")
    (item,) = await world.stored()
    await world.client.delete(ROBOTAPPINSTANCES, item["metadata"]["name"], namespace="default")
    world.now_s += QUIET_S
    assert await world.objects.publish(uid, "") == RACE_S
    await world.objects.publish(uid, "")
    assert [each["metadata"]["name"] for each in await world.stored()] == [item["metadata"]["name"]]


async def test_a_wrong_object_that_only_the_cache_still_has_keeps_nobody_from_the_right_one(
    world: WrittenInstances,
) -> None:
    uid = await world.app()
    body = wanted_object(make_app(uid=uid), "")
    ghost = await world.client.create(ROBOTAPPINSTANCES, body | {"spec": body["spec"] | {"robot": "other"}})
    await world.mirror()
    await world.client.delete(ROBOTAPPINSTANCES, ghost["metadata"]["name"], namespace="default")
    assert await world.objects.publish(uid, "") == RACE_S
    await world.objects.publish(uid, "")
    assert [each["spec"]["robot"] for each in await world.stored()] == [""]


async def test_a_status_is_never_written_over_what_was_not_seen(world: WrittenInstances) -> None:
    uid = await world.app()
    await world.objects.publish(uid, "")
    (item,) = await world.stored()
    key = Stored("robotics.io/robotappinstances", "default", item["metadata"]["name"])
    world.api.store.overwrite(key, item | {"status": {"phase": "Forged"}})
    world.now_s += QUIET_S
    assert await world.objects.publish(uid, "") == RACE_S
    assert (await world.stored())[0]["status"] == {"phase": "Forged"}
    await world.mirror()
    world.now_s += RACE_S
    await world.settle(uid)
    assert (await world.stored())[0]["status"]["phase"] == "Pending"


async def measured(world: WrittenInstances, uid: str, ms: float | None) -> None:
    world.cache.put_telemetry(telemetry("edge-1", amr=ms), now_s=0.0)
    world.cache.touch(uid, "")
    await world.settle(uid)


async def test_figures_that_another_operator_published_are_taken_over_not_fought(world: WrittenInstances) -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "90ms"}}
    uid = await world.app(edges=[edge])
    place(world.cache, uid, operator="edge-1", driver="amr")
    world.memory.of(uid).outcomes[""] = REFUSED
    await measured(world, uid, 40)
    (item,) = await world.stored()
    assert item["status"]["edges"][0]["p95"] == "40ms"
    theirs = json.loads(json.dumps(item["status"]).replace('"40ms"', '"45ms"').replace("40/90ms", "45/90ms"))
    for condition in theirs["conditions"]:
        condition["message"] = condition["message"].replace("40ms of", "45ms of")
    await world.client.replace(ROBOTAPPINSTANCES, item | {"status": theirs}, subresource="status")
    before = world.writes()
    world.now_s += QUIET_S
    await measured(world, uid, 41)
    (item,) = await world.stored()
    assert item["status"]["edges"][0]["p95"] == "45ms"
    assert world.writes() == before
    world.now_s += QUIET_S
    await measured(world, uid, 20)
    (item,) = await world.stored()
    assert item["status"]["edges"][0]["p95"] == "20ms"


async def test_figures_are_written_a_minute_after_the_last_write_was_answered(
    world: WrittenInstances, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "90ms"}}
    uid = await world.app(edges=[edge])
    place(world.cache, uid, operator="edge-1", driver="amr")
    world.memory.of(uid).outcomes[""] = REFUSED
    await measured(world, uid, 40)
    apply = world.client.apply

    async def slow(*args: Any, **fields: Any) -> Any:
        world.now_s += 5.0
        return await apply(*args, **fields)

    async def report(ms: float) -> float | None:
        world.cache.put_telemetry(telemetry("edge-1", amr=ms), now_s=0.0)
        world.cache.touch(uid, "")
        await world.mirror()
        return await world.objects.publish(uid, "")

    monkeypatch.setattr(world.client, "apply", slow)
    world.now_s += QUIET_S
    before = world.writes()
    await report(20)
    assert world.writes() == before + 1
    world.now_s += REST_S - 1.0
    assert await report(60) == 1.0, "a minute has passed since the figures were taken, and not since they were written"
    assert world.writes() == before + 1
    world.now_s += 1.0
    await report(60)
    assert world.writes() == before + 2


async def test_a_dead_link_is_stored_so_that_a_restart_alone_writes_nothing(world: WrittenInstances) -> None:
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "90ms"}}
    uid = await world.app(edges=[edge])
    place(world.cache, uid, operator="edge-1", driver="amr")
    world.memory.of(uid).outcomes[""] = REFUSED
    await measured(world, uid, None)
    (item,) = await world.stored()
    (stored,) = item["status"]["edges"]
    assert (stored["measured"], stored["met"], stored.get("p95")) == (True, False, None)
    before = world.writes()
    await world.mirror()
    world.memory.forget(uid)
    world.memory.of(uid).outcomes[""] = REFUSED
    world.now_s += QUIET_S
    await measured(world, uid, None)
    assert world.writes() == before


async def test_after_a_start_a_refusal_that_was_not_asked_about_yet_stands(world: WrittenInstances) -> None:
    uid = await world.app()
    world.refuse(uid)
    await world.settle(uid)
    before = world.writes()
    world.memory.forget(uid)
    world.now_s += QUIET_S
    assert await world.objects.publish(uid, "") is None
    assert world.writes() == before
    world.cache.claims.put(uid, "c", domain_claim(7, uid=uid))
    await world.settle(uid)
    assert (await world.stored())[0]["status"]["domain"] == 7


async def test_bugs_and_conflicts_are_told_where_they_are(world: WrittenInstances) -> None:
    world.cache.nodes.update(robots("a", "b"))
    uid = await world.app(robots=EACH)
    world.memory.of(uid).bugs["children", "a"] = "KeyError in children"
    world.conflicts[uid, "b"] = "domain 7 is held by somebody else"
    found = {}
    for robot in ("a", "b"):
        world.refuse(uid, robot)
        await world.settle(uid, robot)
    for item in await world.stored():
        found[item["spec"]["robot"]] = {each["type"]: each["reason"] for each in item["status"]["conditions"]}
    assert (found["a"]["Stalled"], found["a"]["Allocated"]) == ("ReconcileError", "DomainExhausted")
    assert (found["b"]["Stalled"], found["b"]["Allocated"]) == ("NotStalled", "ClaimConflict")


async def test_a_robot_whose_node_is_unclear_is_told_so_and_the_others_are_not(world: WrittenInstances) -> None:
    world.cache.nodes.update(robots("a") | {name: make_node(name, robot="b") for name in ("one", "two")})
    uid = await world.app(robots=EACH)
    for robot in ("a", "b"):
        await world.settle(uid, robot)
    accepted = {
        item["spec"]["robot"]: next(each for each in item["status"]["conditions"] if each["type"] == "Accepted")
        for item in await world.stored()
    }
    assert accepted["a"]["status"] == "True"
    assert (accepted["b"]["status"], accepted["b"]["reason"]) == ("False", "RobotNodeUnclear")


async def test_a_robot_whose_name_makes_no_name_of_an_object_is_told_so_and_the_others_run(
    world: WrittenInstances,
) -> None:
    world.cache.nodes.update(robots("a", "B"))
    part = component("driver", envFrom=[{"configMapRef": {"name": "env-$(ROBOTAPP_ROBOT)", "optional": True}}])
    uid = await world.app(robots=EACH, components=[part])
    for robot in ("a", "B"):
        await world.settle(uid, robot)
    accepted = {
        item["spec"]["robot"]: next(each for each in item["status"]["conditions"] if each["type"] == "Accepted")
        for item in await world.stored()
    }
    assert accepted["a"]["status"] == "True"
    assert (accepted["B"]["status"], accepted["B"]["reason"]) == ("False", "InvalidSpec")
    assert '"env-B" is no name of an object' in accepted["B"]["message"]


async def test_a_refused_app_has_objects_that_say_so(world: WrittenInstances) -> None:
    uid = await world.app(ros={"distro": "humbel"})
    await world.settle(uid)
    (item,) = await world.stored()
    assert item["status"]["phase"] == "Failed"


async def test_replicas_with_ordinals_are_components_of_the_status(world: WrittenInstances) -> None:
    part = component("det", replicas=2, replicaIdentity="Ordinal", dependsOn=[{"component": "base"}])
    uid = await world.app(components=[component("base"), part])
    await world.settle(uid)
    (item,) = await world.stored()
    messages = {each["name"]: each.get("message", "") for each in item["status"]["components"]}
    assert set(messages) == {"base", "det-0", "det-1"}
    assert messages["det-1"] == "waits until base is Ready (dependsOn)"
    assert item["status"]["summary"]["ready"] == "0/3"
