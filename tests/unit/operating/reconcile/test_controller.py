"""Keys to work, errors to retry classes."""

import logging
from typing import Any

import msgspec
import pytest
from tests.support.claims.objects import pool_json
from tests.support.factories import app_body, make_app, make_deployment, robots
from tests.unit.operating.controlling import StubbedController

from robotapp_api.model.names import Label, Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.objects import Pool
from robotapp_client import NamespaceTerminating, TooManyRequests, Unreachable
from robotapp_operator.plan.render.instance_object import AppInstance, wanted_object
from robotapp_operator.queue.work import StartOver, Work
from robotapp_operator.queue.workqueue import Key
from robotapp_operator.reconcile.controller import (
    BUG_DELAY_S,
    FIRST_OBJECT_S,
    FIRST_STATUS_S,
    FLEET_REST_S,
    NEXT_IN_LINE_S,
    POOL_REST_S,
    STATUS_REST_S,
    YIELD_S,
)
from robotapp_operator.reconcile.reconcile_state import Unseen
from robotapp_operator.watch.informers import ORPHAN_S

EACH = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


@pytest.fixture
def world() -> StubbedController:
    return StubbedController()


async def test_an_app_asks_for_its_instances_at_once_and_for_its_first_status_when_they_may_have_their_domains(
    world: StubbedController,
) -> None:
    world.cache.update_app(app_body(robots=EACH))
    world.cache.nodes.update(robots("a", "b"))
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {Key(Work.CHILDREN, "uid-1", "a"), Key(Work.CHILDREN, "uid-1", "b")}
    assert world.due(FIRST_STATUS_S) == {Key(Work.STATUS, "uid-1")}
    assert {Key(Work.INSTANCE, "uid-1", "a"), Key(Work.INSTANCE, "uid-1", "b")} < world.due(FIRST_OBJECT_S)


@pytest.mark.parametrize(
    "body",
    [app_body() | {"status": {"phase": "Running"}}, app_body(robots=EACH)],
    ids=["had a status before", "no robot matches"],
)
async def test_an_edit_and_a_refusal_are_told_at_once(world: StubbedController, body: dict[str, Any]) -> None:
    world.cache.update_app(body)
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.STATUS, "uid-1") in world.due()


async def test_objects_of_instances_that_are_gone_are_visited_too(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    body = wanted_object(make_app(), "gone")
    body["metadata"] |= {"uid": "u", "resourceVersion": "1"}
    world.cache.put_instance_object(msgspec.convert(body, AppInstance))
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.INSTANCE, "uid-1", "gone") in world.due(FIRST_OBJECT_S)
    world.cache.forget_app("uid-1")
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due(ORPHAN_S) == {Key(Work.INSTANCE, "uid-1", "gone")}


async def test_children_whose_writes_are_not_seen_yet_are_looked_at_when_that_has_taken_too_long(
    world: StubbedController,
) -> None:
    key = Key(Work.CHILDREN, "uid-1", "a")
    world.cache.update_app(app_body())
    world.children.awaits_s = lambda *_: 5.0
    await world.handle(key)
    assert key not in world.due(4.9)
    assert key in world.due(0.2)


async def test_an_object_is_looked_at_again_when_that_is_asked_for(world: StubbedController) -> None:
    key = Key(Work.INSTANCE, "uid-1", "a")
    world.cache.update_app(app_body())
    world.objects.answer = 5.0
    await world.handle(key)
    assert world.objects.calls == [("uid-1", "a")]
    assert world.due(4.9) == set()
    assert world.due(0.2) == {key}


async def test_moves_are_looked_at_after_every_change_of_an_app_that_can_move_and_of_no_other(
    world: StubbedController,
) -> None:
    key, moves = Key(Work.INSTANCE, "uid-1", ""), Key(Work.MOVES, "uid-1", "")
    world.cache.update_app(app_body())
    await world.handle(key)
    assert moves not in world.due(10)
    edge = {"topic": "/t", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
    world.cache.update_app(app_body(generation=2, edges=[edge]))
    await world.handle(key)
    assert moves in world.due()
    world.mover.answer = 7.0
    await world.handle(moves)
    assert world.mover.calls == [("uid-1", "")]
    assert world.due(6.9) == set()
    assert world.due(0.2) == {moves}


async def test_the_last_ones_of_a_crowd_are_looked_at_again_when_it_is_over(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    body = wanted_object(make_app(), "")
    body["metadata"] |= {"uid": "u", "resourceVersion": "1"}
    world.cache.put_instance_object(msgspec.convert(body, AppInstance))
    for number in range(20):
        world.memory.crowd.note(f"uid-{number}", starts=True, begins=True, now_s=0)
    for number in (0, *range(2, 20)):
        world.memory.crowd.note(f"uid-{number}", starts=False, begins=False, now_s=1)
    await world.handle(Key(Work.STATUS, "uid-2"))
    assert {Key(Work.STATUS, "uid-1"), Key(Work.INSTANCE, "uid-1", "")} <= world.due()


async def test_a_status_is_looked_at_again_when_that_is_asked_for(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    world.reporter.answer = 30.0
    await world.handle(Key(Work.STATUS, "uid-1"))
    assert Key(Work.STATUS, "uid-1") not in world.due(29)
    assert Key(Work.STATUS, "uid-1") in world.due(2)


async def test_background_work_goes_on_while_others_wait_but_slowly(
    world: StubbedController, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []

    async def pause(seconds: float) -> None:
        pauses.append(seconds)

    monkeypatch.setattr("robotapp_operator.reconcile.controller.asyncio.sleep", pause)
    world.cache.update_app(app_body())
    world.queue.add(Key(Work.INSTANCE, "uid-1", "a"))
    world.queue.add(Key(Work.CHILDREN, "uid-1", "a"))
    world.objects.effect = world.queue.close
    await world.controller._background_worker()
    assert pauses == [YIELD_S]
    assert world.objects.calls == [("uid-1", "a")]


async def test_instances_that_are_no_longer_wanted_are_visited_too(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    old = make_deployment("old")
    old.metadata.labels[Label.INSTANCE] = "gone"
    world.cache.deployments.put("uid-1", "old", old)
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.CHILDREN, "uid-1", "gone") in world.due()


async def test_a_refused_app_only_gets_a_status(world: StubbedController) -> None:
    world.cache.update_app(app_body(ros={"distro": "humbel"}))
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {Key(Work.STATUS, "uid-1")}


async def test_a_refused_app_still_visits_instances_that_are_no_longer_its_own(world: StubbedController) -> None:
    world.cache.update_app(app_body(ros={"distro": "humbel"}, robots=EACH))
    world.cache.nodes.update(robots("kept"))
    for robot in ("kept", "revoked"):
        child = make_deployment(robot)
        child.metadata.labels[Label.INSTANCE] = robot
        world.cache.deployments.put("uid-1", robot, child)
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {Key(Work.CHILDREN, "uid-1", "revoked"), Key(Work.STATUS, "uid-1")}


async def test_a_deleted_app_is_forgotten_and_its_claims_are_swept_soon(world: StubbedController) -> None:
    world.memory.of("uid-1").bugs["app", ""] = "x"
    await world.handle(Key(Work.APP, "uid-1"))
    assert len(world.memory) == 0
    assert world.woken == 1


async def test_an_app_that_is_being_deleted_is_left_to_the_garbage_collector(world: StubbedController) -> None:
    body = app_body()
    body["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    world.cache.update_app(body)
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == set()


async def test_a_changed_outcome_is_reported(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    full = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    world.children.effect = lambda: world.memory.of("uid-1").outcomes.update({"": full})
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(1) == {Key(Work.STATUS, "uid-1"), Key(Work.INSTANCE, "uid-1", "")}
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(1) == set()


async def test_whoever_waits_for_a_domain_tries_again_when_one_may_be_free(world: StubbedController) -> None:
    full = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    sharing = {"shareWith": [{"namespace": "default", "name": "owner"}], "pool": "other"}
    for uid, ros2 in {"uid-1": {}, "uid-2": {"pool": "other"}, "uid-3": {}, "uid-4": sharing}.items():
        world.cache.update_app(app_body(uid, uid=uid, ros2=ros2))
        world.memory.of(uid).outcomes["a"] = full
    world.memory.of("uid-3").outcomes["a"] = DomainOutcome(Reason.ALLOCATED, "ok", id=7)
    await world.handle(Key(Work.WAITING, "pool/default"))
    assert world.due() == {Key(Work.CHILDREN, uid, "a") for uid in ("uid-1", "uid-4")}


async def test_one_free_id_wakes_one_of_those_who_wait_and_the_next_one_a_little_later(
    world: StubbedController,
) -> None:
    world.cache.pools["default"] = msgspec.convert(pool_json("1"), Pool)
    for uid in ("uid-1", "uid-2"):
        world.cache.update_app(app_body(uid, uid=uid))
        world.memory.of(uid).outcomes[""] = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    waiting = Key(Work.WAITING, "pool/default")
    await world.handle(waiting)
    assert world.due() == {Key(Work.CHILDREN, "uid-1", "")}
    assert world.due(NEXT_IN_LINE_S) == {waiting}
    await world.handle(waiting)
    assert world.due() == {Key(Work.CHILDREN, "uid-2", "")}


async def test_unfinished_work_backs_off_and_lost_races_too(world: StubbedController) -> None:
    for answer in (False, StartOver("race")):
        world.children.answer = answer
        await world.handle(Key(Work.CHILDREN, "uid-1", ""))
        assert world.due() == set()
        assert world.due(60) == {Key(Work.CHILDREN, "uid-1", "")}


async def test_an_unreachable_server_backs_off_and_its_wish_is_respected(world: StubbedController) -> None:
    world.children.answer = Unreachable("gone", maybe_applied=True)
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(1.5) == {Key(Work.CHILDREN, "uid-1", "")}
    world.children.answer = TooManyRequests("later", status=429, retry_after_s=30)
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(29) == set()
    assert world.due(2) == {Key(Work.CHILDREN, "uid-1", "")}
    assert world.reconciles()["robotapp-children", "error"] == 2


def find_warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


async def test_what_cannot_be_made_in_a_namespace_that_is_being_deleted_is_said_once_and_not_tried_again(
    world: StubbedController, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    ending = NamespaceTerminating("being terminated", status=403)
    for uid in ("uid-1", "uid-2"):
        world.cache.update_app(app_body(uid, uid=uid))
        for worker, work in ((world.children, Work.CHILDREN), (world.objects, Work.INSTANCE)):
            worker.answer = ending
            await world.handle(Key(work, uid, ""))
    assert world.due(120) == set()
    assert caplog.text.count("namespace default is being deleted") == 1
    assert find_warnings(caplog) == []
    assert world.reconciles()["robotapp-children", "success"] == 2
    calls = len(world.children.calls) + len(world.objects.calls)
    for work in (
        Work.CHILDREN,
        Work.INSTANCE,
        Work.MOVES,
        Work.GATES,
    ):  # as the events of its objects' deletion add them
        await world.handle(Key(work, "uid-1", ""))
    assert (len(world.children.calls) + len(world.objects.calls), world.mover.calls, world.gates.calls) == (
        calls,
        [],
        [],
    )


async def test_an_app_of_a_later_namespace_of_that_name_is_worked_on(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    world.children.answer = NamespaceTerminating("being terminated", status=403)
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    world.cache.forget_app("uid-1")
    world.cache.update_app(app_body(uid="uid-2"))
    world.children.answer = True
    await world.handle(Key(Work.CHILDREN, "uid-2", ""))
    assert world.children.calls[-1] == ("uid-2", "")


async def test_the_fleet_view_of_a_namespace_that_is_being_deleted_waits_for_its_next_change(
    world: StubbedController, caplog: pytest.LogCaptureFixture
) -> None:
    world.fleet.answer = NamespaceTerminating("being terminated", status=403)
    for _ in range(2):
        await world.handle(Key(Work.FLEET, "ns/robots"))
        assert world.due(120) == set()
    assert find_warnings(caplog) == []


async def test_a_bug_is_logged_counted_shown_and_does_not_stop_the_others(
    world: StubbedController, caplog: pytest.LogCaptureFixture
) -> None:
    world.cache.update_app(app_body())
    world.children.answer = KeyError("spec")
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert "Traceback" in caplog.text
    assert "KeyError in children" in world.memory.of("uid-1").bug()
    assert "KeyError in children" in world.memory.of("uid-1").bug("")
    assert world.memory.of("uid-1").bug("another") == ""
    assert world.due() == {Key(Work.STATUS, "uid-1"), Key(Work.INSTANCE, "uid-1", "")}
    assert world.due(BUG_DELAY_S) == {Key(Work.CHILDREN, "uid-1", "")}
    world.children.answer = True
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.memory.of("uid-1").bug() == ""
    assert world.due() == {Key(Work.STATUS, "uid-1"), Key(Work.INSTANCE, "uid-1", "")}


async def test_statuses_fleet_views_and_pools_rest_between_two_writes(world: StubbedController) -> None:
    world.cache.update_app(app_body())
    for key, rest_s in (
        (Key(Work.STATUS, "uid-1"), STATUS_REST_S),
        (Key(Work.FLEET, "ns/default"), FLEET_REST_S),
        (Key(Work.POOL, "pool/default"), POOL_REST_S),
    ):
        await world.handle(key)
        world.queue.add(key)
        assert key not in world.due()
        assert key in world.due(rest_s)
    assert world.fleet.calls == world.pools.calls == [("default",)]


async def test_gates_that_cannot_be_opened_yet_are_tried_again(world: StubbedController) -> None:
    world.gates.answer = False
    await world.handle(Key(Work.GATES, "uid-1", "a"))
    assert world.gates.calls == [("uid-1", "a")]
    assert world.due(2) == {Key(Work.GATES, "uid-1", "a")}


async def test_a_full_comparison_finds_what_vanished_unseen(world: StubbedController) -> None:
    world.cache.update_app(app_body("old", uid="uid-old"))
    world.listed = [app_body("new", uid="uid-new")]
    await world.handle(Key(Work.RESYNC, ""))
    assert set(world.cache.apps) == {"uid-new"}
    assert {Key(Work.APP, "uid-new"), Key(Work.APP, "uid-old")} <= world.due() | {Key(Work.APP, "uid-old")}


async def test_instances_that_only_labels_name_are_forgotten_by_a_full_comparison(world: StubbedController) -> None:
    """A tenant who creates and deletes Services of ever new instances of an app of its own filled the operator's memory."""
    world.cache.update_app(app_body())
    world.listed = [app_body()]
    for number in range(50):
        world.cache.touch("uid-1", f"i{number}")
        await world.handle(Key(Work.INSTANCE, "uid-1", f"i{number}"))
    before = world.cache.version_of("uid-1", "i0")
    world.due(3600)
    await world.handle(Key(Work.RESYNC, ""))
    assert "i0" not in repr(vars(world.queue)["_rest_until"])
    assert world.cache.version_of("uid-1", "i0") == 0
    world.cache.touch("uid-1", "i0")
    assert world.cache.version_of("uid-1", "i0") > before


async def test_children_that_are_gone_are_forgotten_but_not_while_ours_are_not_seen_yet(
    world: StubbedController,
) -> None:
    """Whoever deletes Deployments for ever lets the operator create new ones, and it remembered each of them."""
    world.cache.update_app(app_body())
    world.cache.deployments.put("uid-1", "there", make_deployment("there", uid="there"))
    memory = world.memory.of("uid-1")
    memory.settled.update(there=(1, "hash"), gone=(1, "hash"))
    memory.unseen[""] = Unseen(1, 15.0, {})
    await world.handle(Key(Work.APP, "uid-1"))
    assert set(memory.settled) == {"there", "gone"}
    memory.unseen.clear()
    world.due(60)
    await world.handle(Key(Work.APP, "uid-1"))
    assert set(memory.settled) == {"there"}


async def test_an_app_that_comes_or_goes_while_the_list_is_under_way_is_not_misjudged(world: StubbedController) -> None:
    world.cache.update_app(app_body("going", uid="uid-going"))
    world.listed = [app_body("going", uid="uid-going")]

    def meanwhile() -> None:
        world.cache.update_app(app_body("coming", uid="uid-coming"))
        world.cache.forget_app("uid-going")

    world.while_listing = meanwhile
    await world.handle(Key(Work.RESYNC, ""))
    assert set(world.cache.apps) == {"uid-coming"}


async def test_an_app_that_a_restored_etcd_has_again_is_known_after_the_next_full_comparison(
    world: StubbedController,
) -> None:
    world.cache.update_app(app_body())
    world.cache.forget_app("uid-1")
    world.listed = [app_body()]
    await world.handle(Key(Work.RESYNC, ""))
    assert set(world.cache.apps) == {"uid-1"}


@pytest.mark.parametrize("work", [Work.CHILDREN, Work.STATUS, Work.GATES, Work.INSTANCE])
async def test_an_app_that_goes_while_it_is_worked_on_leaves_no_memory(world: StubbedController, work: Work) -> None:
    world.cache.update_app(app_body())

    def going() -> None:
        world.cache.forget_app("uid-1")
        world.memory.of("uid-1").held["a"] = ("x",)

    for worker in (world.children, world.reporter, world.gates, world.objects):
        worker.effect = going
        worker.answer = None
    await world.handle(Key(work, "uid-1", "a"))
    assert len(world.memory) == 0
    world.due(60)
    assert world.queue.retry(Key(work, "uid-1", "a")) == 1, "once it is done with, its failures are forgotten too"


async def test_gated_pods_that_belong_to_no_app_we_know_back_off(world: StubbedController) -> None:
    """Anybody can make them. Each was looked at once a second, and at every event about its pod."""
    key = Key(Work.GATES, "forged", "")
    world.gates.answer = False
    world.queue.add(key)
    for _ in range(600):
        while item := world.queue.pop():
            await world.controller._handle(*item)
        world.queue.add(Key(Work.STATUS, "forged"))  # what a pod's event asks for, besides its gate
        world.queue.add(key)
        world.clock.now_s += 0.5
    assert len(world.gates.calls) <= 11  # in five minutes
    world.gates.answer = True
    world.due(61)
    assert world.queue.retry(key) == 1, "nothing is remembered of a pod that is gone"


async def test_asking_for_what_is_not_known_remembers_nothing(world: StubbedController) -> None:
    assert world.memory.outcome("nobody", "") is None
    world.memory.forget_instances("nobody", set())
    await world.handle(Key(Work.CHILDREN, "nobody", ""))
    assert len(world.memory) == 0


async def test_an_app_of_another_scheduler_has_its_gates_looked_at(world: StubbedController) -> None:
    world.cache.update_app(app_body(schedulerName="by-hand"))
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.GATES, "uid-1", "") in world.due()


async def test_work_ends_when_the_queue_is_closed(world: StubbedController) -> None:
    world.queue.close()
    await world.controller.run(workers=2)
