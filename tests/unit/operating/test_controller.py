"""Keys to work, errors to retry classes."""

from collections.abc import Callable
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from tests.support.factories import app_body, make_deployment, robots

from robotapp_api.claims.domain import DomainOutcome
from robotapp_api.client import TooManyRequests, Unreachable
from robotapp_api.model.names import Label, Reason
from robotapp_operator.cache import Cache
from robotapp_operator.controller import BUG_DELAY_S, FLEET_REST_S, POOL_REST_S, STATUS_REST_S, Controller
from robotapp_operator.execute import StartOver
from robotapp_operator.keys import Work
from robotapp_operator.memory import Memory
from robotapp_operator.metrics import Metrics
from robotapp_operator.queue import Key, Queue

EACH = {"selector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


class Worker:
    """Stands for every collaborator: notes calls, answers or raises what the test says."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.answer: Any = True
        self.forget: Callable[[str], None] = lambda _: None
        self.effect: Callable[[], None] = lambda: None

    async def work(self, *args: Any) -> Any:
        self.calls.append(args)
        self.effect()
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer

    reconcile = report = publish = open = work


class World:
    def __init__(self) -> None:
        self.clock = Clock()
        self.cache = Cache()
        self.memory = Memory()
        self.metrics = Metrics()
        self.queue = Queue(clock=self.clock, jitter=lambda: 0.5)
        self.children, self.reporter, self.fleet, self.gates, self.probes, self.pools = (Worker() for _ in range(6))
        self.children.forget = self.memory.forget
        self.listed: list[dict[str, Any]] = []
        self.while_listing: Callable[[], None] = lambda: None
        self.woken = 0
        self.controller = Controller(
            self.cache,
            self.queue,
            self.memory,
            self.metrics,
            children=self.children,  # type: ignore[arg-type] - doubles
            reporter=self.reporter,  # type: ignore[arg-type]
            fleet=self.fleet,  # type: ignore[arg-type]
            gates=self.gates,  # type: ignore[arg-type]
            probes=self.probes,  # type: ignore[arg-type]
            pools=self.pools,  # type: ignore[arg-type]
            list_apps=self._list,
            wake_sweep=self._wake,
        )

    async def _list(self) -> list[dict[str, Any]]:
        self.while_listing()
        return self.listed

    def _wake(self) -> None:
        self.woken += 1

    async def handle(self, key: Key) -> None:
        self.queue.add(key)
        item = self.queue.pop()
        assert item is not None
        await self.controller._handle(*item)

    def due(self, seconds: float = 0.0) -> set[Key]:
        """Everything that becomes due within `seconds`."""
        self.clock.now_s += seconds
        found = set()
        while item := self.queue.pop():
            found.add(item[0])
            self.queue.done(item[0])
        return found

    def reconciles(self) -> dict[tuple[str, str], float]:
        families = text_string_to_metric_families(self.metrics.render().decode())
        return {
            (sample.labels["controller"], sample.labels["result"]): sample.value
            for family in families
            for sample in family.samples
            if sample.name == "controller_runtime_reconcile_total"
        }


@pytest.fixture
def world() -> World:
    return World()


async def test_an_app_asks_for_its_instances_and_its_status_at_once(world: World) -> None:
    world.cache.update_app(app_body(robots=EACH))
    world.cache.nodes.update(robots("a", "b"))
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {
        Key(Work.CHILDREN, "uid-1", "a"),
        Key(Work.CHILDREN, "uid-1", "b"),
        Key(Work.STATUS, "uid-1"),
    }


async def test_instances_that_are_no_longer_wanted_are_visited_too(world: World) -> None:
    world.cache.update_app(app_body())
    old = make_deployment("old")
    old.metadata.labels[Label.INSTANCE] = "gone"
    world.cache.deployments.put("uid-1", "old", old)
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.CHILDREN, "uid-1", "gone") in world.due()


async def test_a_refused_app_only_gets_a_status(world: World) -> None:
    world.cache.update_app(app_body(ros={"distro": "humbel"}))
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {Key(Work.STATUS, "uid-1")}


async def test_a_refused_app_still_visits_instances_that_are_no_longer_its_own(world: World) -> None:
    world.cache.update_app(app_body(ros={"distro": "humbel"}, robots=EACH))
    world.cache.nodes.update(robots("kept"))
    for robot in ("kept", "revoked"):
        child = make_deployment(robot)
        child.metadata.labels[Label.INSTANCE] = robot
        world.cache.deployments.put("uid-1", robot, child)
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == {Key(Work.CHILDREN, "uid-1", "revoked"), Key(Work.STATUS, "uid-1")}


async def test_a_deleted_app_is_forgotten_and_its_claims_are_swept_soon(world: World) -> None:
    world.memory.of("uid-1").bug = "x"
    await world.handle(Key(Work.APP, "uid-1"))
    assert len(world.memory) == 0
    assert world.woken == 1


async def test_an_app_that_is_being_deleted_is_left_to_the_garbage_collector(world: World) -> None:
    body = app_body()
    body["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    world.cache.update_app(body)
    await world.handle(Key(Work.APP, "uid-1"))
    assert world.due() == set()


async def test_a_changed_outcome_is_reported(world: World) -> None:
    world.cache.update_app(app_body())
    full = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    world.children.effect = lambda: world.memory.of("uid-1").outcomes.update({"": full})
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due() == {Key(Work.STATUS, "uid-1")}
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due() == set()


async def test_whoever_waits_for_a_domain_tries_again_when_one_may_be_free(world: World) -> None:
    world.memory.of("uid-1").outcomes["a"] = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "full")
    world.memory.of("uid-2").outcomes["b"] = DomainOutcome(Reason.ALLOCATED, "ok", id=7)
    await world.handle(Key(Work.WAITING, "pool/default"))
    assert world.due() == {Key(Work.CHILDREN, "uid-1", "a")}


async def test_unfinished_work_backs_off_and_lost_races_too(world: World) -> None:
    for answer in (False, StartOver("race")):
        world.children.answer = answer
        await world.handle(Key(Work.CHILDREN, "uid-1", ""))
        assert world.due() == set()
        assert world.due(60) == {Key(Work.CHILDREN, "uid-1", "")}


async def test_an_unreachable_server_backs_off_and_its_wish_is_respected(world: World) -> None:
    world.children.answer = Unreachable("gone", maybe_applied=True)
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(1.5) == {Key(Work.CHILDREN, "uid-1", "")}
    world.children.answer = TooManyRequests("later", status=429, retry_after_s=30)
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.due(29) == set()
    assert world.due(2) == {Key(Work.CHILDREN, "uid-1", "")}
    assert world.reconciles()["robotapp-children", "error"] == 2


async def test_a_bug_is_logged_counted_shown_and_does_not_stop_the_others(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    world.cache.update_app(app_body())
    world.children.answer = KeyError("spec")
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert "Traceback" in caplog.text
    assert "KeyError in children" in world.memory.of("uid-1").bug
    assert world.due() == {Key(Work.STATUS, "uid-1")}
    assert world.due(BUG_DELAY_S) == {Key(Work.CHILDREN, "uid-1", "")}
    world.children.answer = True
    await world.handle(Key(Work.CHILDREN, "uid-1", ""))
    assert world.memory.of("uid-1").bug == ""


async def test_statuses_fleet_views_and_pools_rest_between_two_writes(world: World) -> None:
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


async def test_gates_that_cannot_be_opened_yet_are_tried_again(world: World) -> None:
    world.gates.answer = False
    await world.handle(Key(Work.GATES, "uid-1", "a"))
    assert world.gates.calls == [("uid-1", "a")]
    assert world.due(2) == {Key(Work.GATES, "uid-1", "a")}


async def test_a_full_comparison_finds_what_vanished_unseen(world: World) -> None:
    world.cache.update_app(app_body("old", uid="uid-old"))
    world.listed = [app_body("new", uid="uid-new")]
    await world.handle(Key(Work.RESYNC, ""))
    assert set(world.cache.apps) == {"uid-new"}
    assert {Key(Work.APP, "uid-new"), Key(Work.APP, "uid-old")} <= world.due() | {Key(Work.APP, "uid-old")}


async def test_an_app_that_comes_or_goes_while_the_list_is_under_way_is_not_misjudged(world: World) -> None:
    world.cache.update_app(app_body("going", uid="uid-going"))
    world.listed = [app_body("going", uid="uid-going")]

    def meanwhile() -> None:
        world.cache.update_app(app_body("coming", uid="uid-coming"))
        world.cache.forget_app("uid-going")

    world.while_listing = meanwhile
    await world.handle(Key(Work.RESYNC, ""))
    assert set(world.cache.apps) == {"uid-coming"}


@pytest.mark.parametrize("work", [Work.CHILDREN, Work.STATUS, Work.GATES])
async def test_an_app_that_goes_while_it_is_worked_on_leaves_no_memory(world: World, work: Work) -> None:
    world.cache.update_app(app_body())

    def going() -> None:
        world.cache.forget_app("uid-1")
        world.memory.of("uid-1").held["a"] = ("x",)

    for worker in (world.children, world.reporter, world.gates):
        worker.effect = going
        worker.answer = False
    await world.handle(Key(work, "uid-1", "a"))
    assert len(world.memory) == 0
    assert world.queue.retry(Key(work, "uid-1", "a")) == 1, "its failures are forgotten too"


async def test_asking_for_what_is_not_known_remembers_nothing(world: World) -> None:
    assert world.memory.outcome("nobody", "") is None
    world.memory.forget_instances("nobody", set())
    await world.handle(Key(Work.CHILDREN, "nobody", ""))
    assert len(world.memory) == 0


async def test_an_app_of_another_scheduler_has_its_gates_looked_at(world: World) -> None:
    world.cache.update_app(app_body(schedulerName="by-hand"))
    await world.handle(Key(Work.APP, "uid-1"))
    assert Key(Work.GATES, "uid-1", "") in world.due()


async def test_work_ends_when_the_queue_is_closed(world: World) -> None:
    world.queue.close()
    await world.controller.run(workers=2)
