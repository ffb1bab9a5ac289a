"""What kopf's events turn into."""

from typing import Any

from tests.support.factories import app_body

from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.kopf_handlers import observe


class HandledObjects:
    def __init__(self) -> None:
        self.cache = Cache()
        self.now_s = 0.0
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0)

    def see(self, kind: str | None, body: dict[str, Any]) -> list[Key]:
        observe(kind, body, self.cache, self.queue)
        found = []
        while item := self.queue.pop():
            found.append(item[0])
            self.queue.done(item[0])
        return found


def version(body: dict[str, Any], number: int) -> dict[str, Any]:
    return body | {"metadata": body["metadata"] | {"resourceVersion": str(number)}}


def test_a_new_app_is_planned() -> None:
    world = HandledObjects()
    assert world.see("ADDED", app_body()) == [Key(Work.APP, "uid-1")]
    assert world.cache.apps["uid-1"].name == "teleop"


def test_the_initial_listing_counts_as_new() -> None:
    assert HandledObjects().see(None, app_body()) == [Key(Work.APP, "uid-1")]


def test_a_status_write_only_compares_the_status() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body())
    written = version(app_body(), 11) | {"status": {"phase": "Running"}}
    assert world.see("MODIFIED", written) == [Key(Work.STATUS, "uid-1")]


def test_an_edit_an_approval_and_a_deletion_plan_anew() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body())
    assert world.see("MODIFIED", version(app_body(generation=2), 11)) == [Key(Work.APP, "uid-1")]
    approved = version(app_body(generation=2), 12)
    approved["metadata"]["annotations"] = {"robotics.io/approve-update": "2"}
    assert world.see("MODIFIED", approved) == [Key(Work.APP, "uid-1")]
    going = version(app_body(generation=2), 13)
    going["metadata"]["deletionTimestamp"] = "2026-01-01T00:00:00Z"
    assert world.see("MODIFIED", going) == [Key(Work.APP, "uid-1")]


def test_a_deleted_app_is_forgotten() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body())
    assert world.see("DELETED", app_body()) == [Key(Work.APP, "uid-1")]
    assert world.cache.apps == {}


def test_agents_are_no_longer_asked_for_the_pairs_of_a_deleted_app() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body())
    assert Key(Work.PROBES, "") not in world.see("DELETED", app_body()), "many may be deleted at once"
    world.now_s += 2.0
    assert Key(Work.PROBES, "") in world.see(None, app_body(uid="uid-2"))


def test_a_late_event_does_not_bring_back_an_older_copy() -> None:
    world = HandledObjects()
    world.see("ADDED", version(app_body(generation=2), 20))
    world.see("MODIFIED", version(app_body(generation=1), 10))
    assert world.cache.apps["uid-1"].generation == 2


def test_an_app_of_the_same_name_is_another_app() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body())
    world.see("ADDED", app_body(uid="uid-2"))
    assert set(world.cache.apps) == {"uid-1", "uid-2"}


def test_whoever_follows_an_app_hears_of_its_birth_edit_and_death_but_not_of_its_status() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body("sharer", uid="uid-2", ros2={"shareWith": [{"name": "teleop"}]}))
    world.see("ADDED", app_body("next", uid="uid-3", ros2={"shareWith": [{"name": "sharer"}]}))
    followers = {Key(Work.APP, "uid-2"), Key(Work.APP, "uid-3")}
    assert set(world.see("ADDED", app_body())) == followers | {Key(Work.APP, "uid-1")}
    assert world.see("MODIFIED", version(app_body(), 11) | {"status": {"phase": "Running"}}) == [
        Key(Work.STATUS, "uid-1")
    ]
    assert followers < set(world.see("MODIFIED", version(app_body(generation=2), 12)))
    assert followers < set(world.see("DELETED", app_body()))


def test_an_edit_ends_the_back_off_of_the_app_and_of_its_followers() -> None:
    world = HandledObjects()
    world.see("ADDED", app_body("sharer", uid="uid-2", ros2={"shareWith": [{"name": "teleop"}]}))
    keys = {Key(Work.CHILDREN, uid, "") for uid in ("uid-1", "uid-2", "uid-3")}
    for key in keys:
        world.queue.add(key)
        world.queue.pop()
        world.queue.retry(key)
    world.see("ADDED", app_body())
    for key in keys:
        world.queue.add(key)
    found = {item[0] for item in iter(world.queue.pop, None)}
    assert found == keys - {Key(Work.CHILDREN, "uid-3", "")}


def test_what_our_own_read_or_write_learned_first_is_still_planned_at_its_event() -> None:
    # The answer to a status write carries the spec as it is by then; the event of that edit comes later.
    world = HandledObjects()
    world.see("ADDED", version(app_body(), 10))
    edited = version(app_body(generation=2), 11)
    world.cache.update_app(edited)
    assert world.see("MODIFIED", edited) == [Key(Work.APP, "uid-1")]
    assert world.see("MODIFIED", version(app_body(generation=2), 12)) == [Key(Work.STATUS, "uid-1")]


def test_a_successor_that_was_read_before_its_event_is_planned() -> None:
    world = HandledObjects()
    world.see("ADDED", version(app_body(), 10))
    world.cache.update_app(version(app_body(uid="uid-2"), 12))
    world.see("DELETED", version(app_body(), 11))
    assert world.see("ADDED", version(app_body(uid="uid-2"), 12)) == [Key(Work.APP, "uid-2")]
