"""Whose turn the work on a group takes."""

from tests.support.factories import app_body

from robotapp_operator.queue.work import namespace_group, pool_group
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache


def make_cache() -> Cache:
    cache = Cache()
    cache.update_app(app_body("teleop", uid="uid-1"))
    return cache


def test_an_apps_work_takes_the_turn_of_its_namespace_and_a_pool_one_of_its_own() -> None:
    cache = make_cache()
    record = cache.apps["uid-1"]
    assert cache.namespace_of("uid-1") == record.namespace
    for group in ("", pool_group("default"), namespace_group("fleet")):
        assert cache.namespace_of(group) == group


def test_uids_that_no_app_has_share_one_turn_so_that_inventing_them_gains_nothing() -> None:
    cache = make_cache()
    queue = Queue(clock=lambda: 0.0, jitter=lambda: 0.5, namespace_of=cache.namespace_of)
    for number in range(300):
        queue.add(Key("children", f"invented-{number}"))
    queue.add(Key("children", "uid-1"))
    groups = [item[0].group for _ in range(2) if (item := queue.pop()) is not None]
    assert "uid-1" in groups
