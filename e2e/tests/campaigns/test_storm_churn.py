"""The churn of a storm: its rate, who goes, and what a server that cannot answer does to it."""

import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from campaigns.storm.churn import Churn
from campaigns.storm.wishes import is_pod
from robotapp_testbed.failures import ApiStatusError


class Server:
    """Keeps the names of what is there; `refuse` may raise instead of an answer, before or after it was done."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.before: Callable[..., None] = lambda *_: None
        self.after: Callable[..., None] = lambda *_: None

    def create(self, _path: str, obj: Any) -> None:
        name = obj["metadata"]["name"]
        self.before("create", name)
        self.names.add(name)
        self.after("create", name)

    def delete(self, path: str) -> None:
        name = path.rpartition("/")[2]
        self.before("delete", name)
        if name not in self.names:
            raise ApiStatusError("DELETE", path, 404, "gone")
        self.names.discard(name)


class StormedCluster:
    namespace, apps_path = "ours", "/apis/ours/robotapps"

    def __init__(self) -> None:
        self.server = Server()
        self.cp = type("Plane", (), {"api": self.server})()


def churn(world: StormedCluster, *, wanted: int = 100, held: Callable[[], set[str]] = set, full: bool = False) -> Churn:
    return Churn(world, wanted=wanted, chance=random.Random(1), holders=held, full=full)  # type: ignore[arg-type]


def rounds(of: Churn, count: int) -> None:
    with ThreadPoolExecutor(4) as people:
        for _ in range(count):
            of._round(people)


def names(of: Churn) -> set[str]:
    return {name for _, name in of.there}


def test_first_all_come_then_a_tenth_goes_in_each_round_four_fifths_of_them_holders() -> None:
    world = StormedCluster()
    storm = churn(world, held=lambda: {f"s-{number}" for number in range(60)})
    rounds(storm, 1)
    assert (storm.made, storm.gone, len(names(storm))) == (100, 0, 100)
    before = names(storm)
    rounds(storm, 1)
    gone = before - names(storm)
    assert (storm.made, storm.gone, len(gone)) == (110, 10, 10)
    assert sum(int(name[2:]) < 60 for name in gone) == 8
    assert names(storm) == world.server.names


def test_where_few_hold_something_few_go_and_that_is_told() -> None:
    storm = churn(StormedCluster(), held=lambda: {"s-1", "s-2", "s-3", "s-4"})
    rounds(storm, 2)
    assert storm.gone == 5
    storm._rounds_s = [0.1, 0.1]
    assert storm.limit == "grants (in 50% of the rounds too few held anything)"


def test_a_full_churn_keeps_its_rate_with_those_that_wait() -> None:
    storm = churn(StormedCluster(), held=lambda: {"s-1", "s-2", "s-3", "s-4"}, full=True)
    rounds(storm, 3)
    assert storm.gone == 20
    storm._rounds_s = [0.1, 0.1]
    assert storm.limit == "nothing"


def test_some_go_although_nobody_holds_anything() -> None:
    storm = churn(StormedCluster())
    rounds(storm, 4)
    assert storm.gone == 3


def test_slow_answers_are_told_as_what_limits_it() -> None:
    storm = churn(StormedCluster())
    storm._rounds_s = [0.5, 2.0, 4.0]
    assert storm.limit == "the API server (67% of the rounds took longer than a second, 3.0 s)"
    storm._rounds_s = [0.5]
    assert storm.limit == "nothing"


def test_what_an_overloaded_server_has_done_or_not_is_deleted_in_the_next_round() -> None:
    world = StormedCluster()
    storm = churn(world, wanted=20)

    def overloaded(verb: str, name: str) -> None:
        if verb == "create" and name in {"s-3", "s-7"}:
            raise ApiStatusError("POST", name, 504, "timeout") if name == "s-3" else TimeoutError

    world.server.after = overloaded
    rounds(storm, 1)
    assert (storm.unanswered, len(storm.there)) == (2, 18)
    assert {"s-3", "s-7"} <= world.server.names
    rounds(storm, 1)
    assert len(storm.there) == 20
    assert names(storm) == world.server.names


def test_an_error_that_is_not_the_servers_load_ends_the_churn_and_is_raised_where_it_is_looked_for() -> None:
    world = StormedCluster()

    def forbidden(_verb: str, name: str) -> None:
        raise ApiStatusError("POST", name, 403, "no")

    world.server.before = forbidden
    storm = churn(world)
    with pytest.raises(ApiStatusError, match="403"), storm:
        storm._thread.join(60)
    with pytest.raises(ApiStatusError, match="403"):
        storm.check()


def test_in_a_thread_of_its_own_it_goes_on_while_nobody_looks() -> None:
    world = StormedCluster()
    storm = churn(world, wanted=10)
    with storm:
        deadline_s = time.monotonic() + 30
        while not storm.there and time.monotonic() < deadline_s:
            time.sleep(0.01)
    assert len(world.server.names) == 10
    assert any(is_pod(kind) for kind, _ in storm.there)
    storm.keep(storm.there[:3])
    assert world.server.names == {name for _, name in storm.there[:3]}
