"""What one user's informer set costs: how often models are built, what is read of events, which feeds are kept."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import pytest
from tests.support.clients import FakeTime, until
from tests.unit.console.guarded_api import ADMIN, NODES, TELEMETRY, VIEWER, GuardedApi
from tests.unit.console.objects import node, telemetry

from robotapp_client import Endpoint
from robotapp_client.transport.credentials import Credentials
from robotapp_console.cluster.informer_set import (
    IN_USE_S,
    LEAST_PAUSE_S,
    MOST_DEBT_S,
    MOST_SCOPES,
    MOST_WAITING,
    SCOPE_IDLE_S,
    SHARE,
    TICK_S,
    InformerSet,
)
from robotapp_console.cluster.kinds import APPS, NODE_KIND
from robotapp_console.cluster.kinds import TELEMETRY as REPORTS
from robotapp_console.views.snapshot import Snapshot


@dataclass
class Builder:
    """Builds models that take `cost_s` of the fake time."""

    cost_s: float = 0.1
    time: FakeTime = field(default_factory=FakeTime)
    spent_s: float = 0.0
    built: list[str] = field(default_factory=list)

    def build(self, name: str) -> Callable[[Snapshot], str]:
        def build_one(snapshot: Snapshot) -> str:
            del snapshot
            self.time.now_s += self.cost_s
            self.spent_s += self.cost_s
            self.built.append(name)
            return name

        return build_one


def make_informers(builder: Builder) -> InformerSet:
    return InformerSet(Endpoint("http://127.0.0.1:1"), clock=builder.time.clock, sleep=builder.time.sleep)


def show(informers: InformerSet, builder: Builder, name: str) -> None:
    informers.build_model(("fleet",), builder.build(name), namespace=name, home="")


@pytest.mark.parametrize("pages", [1, 3, 30])
@pytest.mark.parametrize(("counters", "tenths"), [(("version",), 1), (("version", "edits"), 2)])
def test_reports_without_end_take_a_tenth_of_a_core_and_edits_two_however_many_pages_are_open(
    pages: int, counters: tuple[str, ...], tenths: int
) -> None:
    builder = Builder()
    informers = make_informers(builder)
    names = [f"n{number}" for number in range(pages)]
    for name in names:
        show(informers, builder, name)
    begun_s, builder.spent_s = builder.time.now_s, 0.0
    builder.built.clear()
    while builder.time.now_s - begun_s < 200.0:
        for counter in counters:
            setattr(informers, counter, getattr(informers, counter) + 1)
        for name in names:
            show(informers, builder, name)
        builder.time.now_s += 0.05
    elapsed_s = builder.time.now_s - begun_s
    assert 0.05 * elapsed_s < builder.spent_s <= (1.1 * tenths * elapsed_s + MOST_DEBT_S) / SHARE
    assert set(builder.built) == set(names), "no page waits for ever"


def test_an_edit_shows_at_once_also_where_reports_took_their_tenth_of_a_core() -> None:
    builder = Builder(cost_s=0.05)
    informers = make_informers(builder)
    show(informers, builder, "a")
    informers._note_report()
    assert informers.pause_s(("fleet",), namespace="a", home="") == pytest.approx(SHARE * builder.cost_s)
    informers._note_edit()
    assert informers.pause_s(("fleet",), namespace="a", home="") == pytest.approx(LEAST_PAUSE_S)
    builder.time.now_s += LEAST_PAUSE_S
    show(informers, builder, "a")
    assert builder.built == ["a", "a"]


def test_a_model_is_built_anew_after_a_while_because_agents_fall_silent_without_a_change() -> None:
    builder = Builder()
    informers = make_informers(builder)
    show(informers, builder, "a")
    builder.time.now_s += TICK_S - 1.0
    show(informers, builder, "a")
    assert builder.built == ["a"]
    builder.time.now_s += 1.0
    show(informers, builder, "a")
    assert builder.built == ["a", "a"]


async def test_an_object_that_is_written_again_as_it_was_is_no_change() -> None:
    async with GuardedApi() as api:
        api.put(NODES, node("amr-07"))
        api.put(TELEMETRY, telemetry("amr-07", rtt={"edge-1": 2.0}))
        informers = InformerSet(Endpoint(api.endpoint.server, credentials=Credentials.fixed(ADMIN)))
        await informers.open()
        try:
            await informers.use((NODE_KIND, REPORTS), "")
            await until(lambda: api.watching == 2, what="both watches")
            version = informers.version
            for seq in (6, 7, 8):
                api.put(NODES, node("amr-07"))
                api.put(TELEMETRY, telemetry("amr-07", rtt={"edge-1": 2.0}, seq=seq))
            api.put(NODES, node("amr-07", zone="hall-9"))
            api.put(TELEMETRY, telemetry("amr-07", rtt={"edge-1": 7.0}, seq=9))
            await until(lambda: informers.version == version + 2, what="the two changes")
            await asyncio.sleep(0.1)
            assert informers.version == version + 2
        finally:
            await informers.close()


def test_a_page_that_nobody_looks_at_any_more_slows_no_other() -> None:
    builder = Builder()
    informers = make_informers(builder)
    for name in ("a", "b"):
        show(informers, builder, name)
    informers.version += 1
    assert informers.pause_s(("fleet",), namespace="b", home="") == pytest.approx(2 * SHARE * builder.cost_s)
    builder.time.now_s += IN_USE_S
    show(informers, builder, "b")
    assert informers.pause_s(("fleet",), namespace="b", home="") == pytest.approx(SHARE * builder.cost_s)


async def test_new_addresses_are_built_at_once_until_they_took_their_share_and_then_wait() -> None:
    builder = Builder()
    informers = make_informers(builder)

    begun_s = builder.time.now_s
    for number in range(200):
        assert await informers.wait_for_first_build(("fleet",), namespace=f"n{number}", home="")
        show(informers, builder, f"n{number}")
    elapsed_s = builder.time.now_s - begun_s
    assert builder.spent_s <= (elapsed_s + MOST_DEBT_S) / SHARE + 2 * builder.cost_s


async def test_only_so_many_new_addresses_wait_and_known_ones_never_do() -> None:
    builder, ended = Builder(cost_s=MOST_DEBT_S), asyncio.Event()

    async def wait_for_the_end(seconds: float) -> None:
        builder.time.now_s += seconds
        await ended.wait()

    informers = InformerSet(Endpoint("http://127.0.0.1:1"), clock=builder.time.clock, sleep=wait_for_the_end)
    show(informers, builder, "known")
    waiting = [
        asyncio.create_task(informers.wait_for_first_build(("fleet",), namespace=f"n{number}", home=""))
        for number in range(MOST_WAITING)
    ]
    await asyncio.sleep(0)
    assert not await informers.wait_for_first_build(("fleet",), namespace="another", home="")
    assert await informers.wait_for_first_build(("fleet",), namespace="known", home="")
    ended.set()
    assert all(await asyncio.gather(*waiting))
    assert await informers.wait_for_first_build(("fleet",), namespace="another", home="")


def list_scopes(informers: InformerSet) -> set[str]:
    return {namespace for _, namespace in informers._feeds if namespace}


@asynccontextmanager
async def opened(time: FakeTime) -> AsyncIterator[tuple[GuardedApi, InformerSet]]:
    """Gives the set of a user who may read namespaces one by one, and none of them together."""
    async with GuardedApi() as api:
        endpoint = Endpoint(api.endpoint.server, credentials=Credentials.fixed(VIEWER))
        informers = InformerSet(endpoint, clock=time.clock)
        await informers.open()
        try:
            yield api, informers
        finally:
            await informers.close()


async def test_of_many_namespaces_those_that_pages_show_are_followed_and_the_watches_of_the_others_end() -> None:
    async with opened(FakeTime()) as (api, informers):
        await informers.use((APPS,), "team-a")
        await until(lambda: api.watching == 1, what="the watch of team-a")
        for number in range(MOST_SCOPES + 5):
            show(informers, Builder(), "team-a")
            await informers.use((APPS,), f"n{number}")
        assert len(list_scopes(informers)) == MOST_SCOPES
        assert "team-a" in list_scopes(informers)
        assert api.watching == 1
        for number in range(MOST_SCOPES):
            await informers.use((APPS,), f"m{number}")
        assert "team-a" not in list_scopes(informers)
        await until(lambda: api.watching == 0, what="the watch has ended")
        await until(lambda: len(informers._tasks) == 2 + 1 + MOST_SCOPES, what="tasks of ended feeds are forgotten")
        await informers.use((APPS,), "team-a")
        await until(lambda: api.watching == 1, what="it is followed again")


async def test_a_namespace_that_no_page_shows_any_more_is_not_followed_for_ever() -> None:
    time = FakeTime()
    async with opened(time) as (api, informers):
        for name in ("team-a", "team-b"):
            await informers.use((APPS,), name)
        time.now_s += SCOPE_IDLE_S
        show(informers, Builder(), "team-b")
        time.now_s += 1.0
        informers._end_idle_scopes()
        assert list_scopes(informers) == {"team-b"}
        await until(lambda: api.watching == 0, what="the watch of team-a has ended")
