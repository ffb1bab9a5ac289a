"""Of those who wait for a domain as many try as there are ids, in turn; who waits for something else is always asked."""

import msgspec
from tests.support.claims import objects as make
from tests.support.factories import app_body

from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.objects import Pool
from robotapp_operator.reconcile.domain_pools import Line
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.watch.cache import Cache


class DomainQueue:
    def __init__(self, ids: str = "1-3", *, scope: str = "Cluster") -> None:
        self.cache, self.memory = Cache(), ReconcileState()
        self.cache.pools["default"] = msgspec.convert(make.pool_json(ids, scope=scope), Pool)
        self.line = Line(self.cache, self.memory)

    def wait(self, *uids: str, reason: Reason = Reason.DOMAIN_EXHAUSTED, **ros2: object) -> None:
        for uid in uids:
            self.cache.update_app(app_body(uid, uid=uid, ros2=ros2))
            self.memory.of(uid).outcomes[""] = DomainOutcome(reason, "x")

    def claimed(self, *ids: int) -> None:
        for number in ids:
            claim = make.domain_claim(number, make.app_holder(f"holder-{number}"))
            self.cache.claims.put(claim.holder.uid, claim.name, claim)

    def next(self) -> tuple[list[str], bool]:
        chosen, others = self.line.next("default")
        return [uid for uid, _ in chosen], others


def test_as_many_try_as_ids_are_free_and_each_in_its_turn() -> None:
    world = DomainQueue("1-3")
    world.claimed(1)
    world.wait(*"abcde")
    assert [world.next() for _ in range(3)] == [(["a", "b"], True), (["c", "d"], True), (["e", "a"], True)]


def test_nobody_tries_while_every_id_is_claimed_and_nobody_is_asked_again() -> None:
    world = DomainQueue("1-2")
    world.claimed(1, 2)
    world.wait(*"abc")
    assert world.next() == ([], False)


def test_the_last_one_in_line_is_not_waited_for() -> None:
    world = DomainQueue("1-2")
    world.wait("a")
    assert world.next() == (["a"], False)


def test_the_turn_goes_on_when_who_had_it_is_gone() -> None:
    world = DomainQueue("1")
    world.wait(*"abc")
    assert world.next() == (["a"], True)
    world.cache.forget_app("a")
    world.memory.forget("a")
    assert {*world.next()[0], *world.next()[0]} == {"b", "c"}


def test_an_app_without_any_domain_comes_before_further_instances_of_one_that_has_some() -> None:
    world = DomainQueue("1-3")
    world.wait("sweep")
    for number in (1, 2):
        claim = make.domain_claim(number, make.app_holder("sweep", instance=f"run-{number}"))
        world.cache.claims.put("sweep", claim.name, claim)
    world.wait("other")
    assert world.next() == (["other"], True)
    world.memory.of("other").outcomes[""] = DomainOutcome(Reason.ALLOCATED, "x", id=3)
    assert world.next() == (["sweep"], False)


def hold_one(world: DomainQueue, uid: str) -> None:
    claim = make.domain_claim(1, make.app_holder(uid, instance="run-1"))
    world.cache.claims.put(uid, claim.name, claim)


def test_apps_without_any_domain_that_try_in_vain_again_and_again_keep_nobody_from_a_free_id() -> None:
    world = DomainQueue("1-2")
    hold_one(world, "sweep")
    world.wait("sweep", *"ab")
    asked = [uid for _ in range(9) for uid in world.next()[0]]
    assert asked[:2] == ["a", "b"], "first those without any"
    assert [asked.count(uid) for uid in ("a", "b", "sweep")] == [3, 3, 3]


def test_an_app_that_comes_late_is_no_turns_behind_nor_ahead_of_those_that_have_tried_for_long() -> None:
    world = DomainQueue("1-2")
    hold_one(world, "sweep")
    world.wait("sweep", "a")
    assert [world.next()[0] for _ in range(21)][-1] == ["a"]
    world.wait("late")
    assert sorted(uid for _ in range(3) for uid in world.next()[0]) == ["a", "late", "sweep"]


def test_an_app_that_is_being_deleted_or_goes_with_its_namespace_stands_in_no_line() -> None:
    world = DomainQueue("1")
    world.wait(*"abc")
    body = app_body("a", uid="a")
    world.cache.update_app({**body, "metadata": {**body["metadata"], "deletionTimestamp": "2026-01-01T00:00:00Z"}})
    world.memory.of("b").namespace_ends = True
    assert [world.next() for _ in range(2)] == [(["c"], False), (["c"], False)]


def test_nobody_waits_for_ever_behind_those_who_leave_and_come_back() -> None:
    world = DomainQueue("1")
    world.wait(*"abc")
    asked = []
    for returns in ("", "", "a", "b"):
        if returns:
            world.wait(returns)
        (uid,), _ = world.next()
        asked.append(uid)
        world.memory.of(uid).outcomes[""] = DomainOutcome(Reason.ALLOCATED, "x", id=1)  # and lets go of it soon
    assert asked == ["a", "b", "c", "a"]


def test_who_was_refused_for_another_reason_than_a_full_pool_is_asked_each_time() -> None:
    world = DomainQueue("1")
    world.claimed(1)
    world.wait("quota", reason=Reason.QUOTA_EXCEEDED)
    world.wait("number", domain=7)
    world.wait("sharing", shareWith=[{"namespace": "default", "name": "other"}])
    world.wait("auto")
    assert world.next() == (["quota", "number", "sharing"], False)


def test_pools_that_count_by_zone_and_pools_that_are_not_known_ask_everybody() -> None:
    world = DomainQueue("1", scope="Zone")
    world.wait(*"abc")
    assert world.next() == (["a", "b", "c"], False)
    world.cache.pools.clear()
    assert world.next() == (["a", "b", "c"], False)
