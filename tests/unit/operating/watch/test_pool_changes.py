"""A pool decides whether apps that name a domain id are accepted: they hear of its changes."""

from tests.support.factories import app_body

from robotapp_claims.rules.objects import Pool, PoolMeta, PoolSpec
from robotapp_client import ApiClient, Change, Endpoint
from robotapp_operator.queue.work import BACKGROUND, Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.informers import Informers

ASKING = Key(Work.APP, "asks")


def woken(pool: str, *apps: dict[str, object]) -> set[Key]:
    """The keys that a new pool asks for."""
    cache, queue = Cache(), Queue(clock=lambda: 0.0, jitter=lambda: 0.0, background=BACKGROUND)
    for app in apps:
        cache.update_app(app)
    client = ApiClient(Endpoint("http://localhost"), user_agent="test")
    informers = Informers(client, cache, queue, namespaces=(), request_sweep=lambda: None, clock=lambda: 0.0)
    informers._pool(
        Change("ADDED", pool, None, Pool(metadata=PoolMeta(name=pool), spec=PoolSpec(ids="1-9", reserved=(7,))))
    )
    found = set()
    while item := queue.pop() or queue.pop(background=True):
        found.add(item[0])
        queue.done(item[0])
    return found


def test_a_pool_that_reserves_other_ids_wakes_the_apps_that_name_a_number() -> None:
    assert ASKING in woken("default", app_body("asks", uid="asks", ros2={"domain": 7}))


def test_apps_of_another_pool_and_those_that_take_any_id_are_left_alone() -> None:
    named, takes_any = app_body("asks", uid="asks", ros2={"domain": 7}), app_body("asks", uid="asks")
    assert ASKING not in woken("other", named)
    assert ASKING not in woken("default", takes_any)
