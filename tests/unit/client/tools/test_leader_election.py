"""Leader election in a time the test moves: taking, keeping, losing, giving back; whose clock counts."""

import asyncio
import random
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.apiserver import Key, Store
from tests.support.seeds import count_examples
from tests.unit.client.memory import ManualTime, MemoryTransport, Mishap, memory_client, settle

from robotapp_client.tools.leader_election import LeaderElection, boot_time, candidate_identity

KEY = Key("coordination.k8s.io/leases", "robots", "scheduler")
NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)


class Candidate:
    """One process that wants to lead, with a clock and a network of its own."""

    def __init__(self, store: Store, name: str, *, wrong_by: timedelta = timedelta(), **settings: Any) -> None:
        self.time = ManualTime()
        self.suspended_s = 0.0
        self.network = MemoryTransport(store)
        self.said: list[str] = []
        client = memory_client(self.network, self.time)
        self.election = LeaderElection(
            client,
            "robots",
            "scheduler",
            name,
            now=lambda: NOON + wrong_by + timedelta(seconds=self.time.now_s),
            clock=lambda: self.time.now_s + self.suspended_s,
            **settings,
        )
        self.task = asyncio.create_task(
            self.election.run(lambda: self.said.append("started"), lambda: self.said.append("lost"))
        )

    @property
    def leads(self) -> bool:
        return self.election.is_leader

    async def stop(self) -> None:
        self.task.cancel()
        while not self.task.done():
            await self.time.advance(1)


@asynccontextmanager
async def candidates(*names: str, **options: dict[str, Any]) -> AsyncIterator[tuple[Any, ...]]:
    """The store and one candidate per name, the first of which already leads."""
    store = Store()
    started = []
    for name in names:
        started.append(Candidate(store, name, **options.get(name, {})))
        await settle()
    try:
        yield store, *started
    finally:
        for candidate in started:
            await candidate.stop()


async def pass_time(seconds: float, *candidates: Candidate) -> None:
    for _ in range(round(seconds * 2)):
        for candidate in candidates:
            await candidate.time.advance(0.5)


async def test_the_first_one_creates_the_lease_and_leads() -> None:
    async with candidates("a") as (store, a):
        assert a.leads
        assert a.said == ["started"]
        assert store.objects[KEY]["spec"] == {
            "holderIdentity": "a",
            "leaseDurationSeconds": 15,
            "acquireTime": "2026-01-01T12:00:00.000000Z",
            "renewTime": "2026-01-01T12:00:00.000000Z",
            "leaseTransitions": 0,
        }


async def test_a_leader_renews_and_keeps_the_time_it_was_acquired() -> None:
    async with candidates("a") as (store, a):
        await pass_time(20, a)
        spec = store.objects[KEY]["spec"]
        assert spec["renewTime"] == "2026-01-01T12:00:20.000000Z"
        assert spec["acquireTime"] == "2026-01-01T12:00:00.000000Z"
        assert spec["leaseTransitions"] == 0


async def test_renewing_costs_one_request() -> None:
    async with candidates("a") as (_, a):
        a.network.seen.clear()
        await pass_time(10, a)
        assert [method for method, _ in a.network.seen] == ["PUT"] * 5


async def test_a_second_one_waits_as_long_as_the_first_one_renews() -> None:
    async with candidates("a", "b") as (_, a, b):
        await pass_time(120, a, b)
        assert (a.leads, b.leads) == (True, False)
        assert b.election.holder == "a"
        assert repr(b.election) == "<LeaderElection robots/scheduler as b: waiting for a>"


async def test_a_dead_leader_is_replaced_after_the_lease_was_watched_unchanged_for_its_duration() -> None:
    async with candidates("a", "b") as (store, _, b):
        await pass_time(14, b)
        assert not b.leads
        await pass_time(3, b)
        assert b.leads
        assert store.objects[KEY]["spec"]["leaseTransitions"] == 1
        assert store.objects[KEY]["spec"]["holderIdentity"] == "b"


@pytest.mark.parametrize("hours", [-5, 5])
async def test_wall_clocks_do_not_matter(hours: int) -> None:
    async with candidates("a", "b", b={"wrong_by": timedelta(hours=hours)}) as (_, a, b):
        await pass_time(60, a, b)
        assert (a.leads, b.leads) == (True, False)


async def test_a_newcomer_watches_for_a_whole_duration_however_old_the_lease_looks() -> None:
    async with candidates("a") as (store, a):
        await pass_time(4, a)
        a.network.down = True
        late = Candidate(store, "late", wrong_by=timedelta(hours=1))
        await settle()
        await pass_time(14, late)
        assert not late.leads
        await late.stop()


async def test_the_duration_that_counts_is_the_one_the_holder_wrote() -> None:
    async with candidates("a") as (store, _):
        hasty = Candidate(store, "hasty", lease_duration_s=3, renew_deadline_s=2, retry_period_s=1)
        await pass_time(10, hasty)
        assert not hasty.leads
        await hasty.stop()


async def test_a_stopped_leader_gives_the_lease_back_at_once() -> None:
    async with candidates("a", "b") as (store, a, b):
        await a.stop()
        assert "holderIdentity" not in store.objects[KEY]["spec"]
        assert a.said == ["started"]
        await pass_time(3, b)
        assert b.leads


async def test_giving_back_never_takes_it_from_another() -> None:
    async with candidates("a", "b") as (store, a, b):
        await pass_time(17, b)
        assert b.leads
        await a.stop()
        assert store.objects[KEY]["spec"]["holderIdentity"] == "b"


async def test_a_stop_while_the_server_is_down_is_still_a_stop() -> None:
    async with candidates("a") as (_, a):
        a.network.down = True
        await a.stop()
        assert a.task.cancelled()


async def test_an_outage_shorter_than_the_deadline_is_survived() -> None:
    async with candidates("a") as (_, a):
        a.network.down = True
        await pass_time(7, a)
        a.network.down = False
        await pass_time(30, a)
        assert a.leads
        assert a.said == ["started"]


async def test_an_outage_longer_than_the_deadline_is_reported_before_another_can_lead() -> None:
    async with candidates("a", "b") as (_, a, b):
        a.network.down = True
        led_together = False
        for _ in range(60):
            await pass_time(0.5, a, b)
            led_together |= a.leads and b.leads
        assert not led_together
        assert a.said == ["started", "lost"]
        assert a.task.done()
        assert b.leads


async def test_a_lease_taken_by_force_is_lost_at_once() -> None:
    async with candidates("a") as (store, a):
        lease = store.get(KEY)
        lease["spec"] |= {"holderIdentity": "thief", "renewTime": "x"}
        store.update(KEY, lease)
        await pass_time(4.5, a)
        assert a.said == ["started", "lost"]
        assert not a.leads


async def test_a_lease_deleted_under_its_leader_is_made_again() -> None:
    async with candidates("a") as (store, a):
        store.delete(KEY, {})
        await pass_time(5, a)
        assert a.leads
        assert store.objects[KEY]["spec"]["holderIdentity"] == "a"


@pytest.mark.parametrize("mishap", [Mishap.LOST, Mishap.DROPPED, Mishap.REFUSED])
async def test_a_renewal_without_an_answer_is_looked_up_not_repeated_blindly(mishap: Mishap) -> None:
    async with candidates("a") as (_, a):
        a.network.seen.clear()
        a.network.mishaps.append(mishap)
        await pass_time(4.5, a)
        assert [method for method, _ in a.network.seen] == ["PUT", "GET", "PUT"]
        assert a.leads


async def test_a_process_that_was_stopped_knows_at_once_that_it_may_not_lead() -> None:
    async with candidates("a") as (_, a):
        a.time.jump(11)
        assert not a.leads
        await pass_time(3, a)
        assert a.said == ["started", "lost"]


async def test_a_machine_that_was_suspended_does_not_lead_when_it_wakes_up() -> None:
    """The monotonic clock stands still meanwhile; by that one the old leader would lead for up to ten seconds beside the new."""
    async with candidates("a", "b") as (_, a, b):
        a.suspended_s = 17
        await pass_time(17, b)
        assert b.leads
        assert not a.leads
        await pass_time(3, a)
        assert a.said == ["started", "lost"]


async def test_a_suspended_candidate_has_watched_nothing_meanwhile() -> None:
    async with candidates("a", "b") as (_, a, b):
        await pass_time(4, a, b)
        b.suspended_s = 3600
        a.network.down = True
        await pass_time(10, b)
        assert not b.leads
        await pass_time(8, b)
        assert b.leads


def test_leadership_runs_out_by_the_clock_that_counts_a_suspend() -> None:
    found = LeaderElection(memory_client(MemoryTransport(Store()), ManualTime()), "n", "l", "a")
    assert found._clock is boot_time
    assert abs(boot_time() - time.clock_gettime(time.CLOCK_BOOTTIME)) < 1


async def test_two_that_see_an_abandoned_lease_do_not_both_get_it() -> None:
    async with candidates("dead", "b", "c") as (store, _, b, c):
        for _ in range(60):
            await asyncio.gather(b.time.advance(0.5), c.time.advance(0.5))
            assert not (b.leads and c.leads)
        assert b.leads or c.leads
        assert store.objects[KEY]["spec"]["leaseTransitions"] == 1


async def test_who_finds_the_lease_taken_between_reading_and_writing_it_does_not_lead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with candidates("dead", "b") as (store, _, b):
        request, overtaken = b.network.request, []

        async def overtake(method: str, path: str, **sent: Any) -> Any:
            if method == "PUT":
                overtaken.append(path)
                lease = store.get(KEY)
                lease["spec"] |= {"holderIdentity": "c", "renewTime": str(len(overtaken))}
                store.update(KEY, lease)
            return await request(method, path, **sent)

        monkeypatch.setattr(b.network, "request", overtake)
        await pass_time(20, b)
        assert overtaken
        assert not b.leads
        assert b.said == []
        assert store.objects[KEY]["spec"]["holderIdentity"] == "c"


async def test_a_renewal_that_hangs_is_given_up_at_the_deadline() -> None:
    store = Store()
    network = MemoryTransport(store)
    time = ManualTime()
    client = memory_client(network, time)
    # asyncio's own clock decides here, so the periods are real and short.
    client.clock, client.sleep = asyncio.get_running_loop().time, asyncio.sleep
    said: list[str] = []
    election = LeaderElection(
        client, "robots", "scheduler", "a", lease_duration_s=0.3, renew_deadline_s=0.2, retry_period_s=0.05
    )
    network.mishaps = [None, None, Mishap.HANGS]
    await asyncio.wait_for(election.run(lambda: said.append("started"), lambda: said.append("lost")), timeout=60)
    assert said == ["started", "lost"]


async def test_an_exception_in_the_work_gives_the_lease_back() -> None:
    def stumble() -> None:
        raise RuntimeError("bug")

    store, time = Store(), ManualTime()
    election = LeaderElection(memory_client(MemoryTransport(store), time), "robots", "scheduler", "a", clock=time.clock)
    with pytest.raises(RuntimeError, match="bug"):
        await election.run(stumble, lambda: None)
    assert "holderIdentity" not in store.objects[KEY]["spec"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"lease_duration_s": 10, "renew_deadline_s": 10},
        {"renew_deadline_s": 2, "retry_period_s": 2},
        {"retry_period_s": 0},
    ],
)
async def test_periods_that_cannot_work_are_refused(wrong: dict[str, float]) -> None:
    client = memory_client(MemoryTransport(Store()), ManualTime())
    with pytest.raises(ValueError, match="duration > renew deadline"):
        LeaderElection(client, "n", "l", "a", **wrong)
    with pytest.raises(ValueError, match="identity of a candidate is empty"):
        LeaderElection(client, "n", "l", "")


@settings(max_examples=count_examples(50), deadline=None)
@given(seed=st.integers(0, 2**32), trouble=st.floats(0, 0.9))
def test_whatever_happens_to_requests_two_never_lead_at_once(seed: int, trouble: float) -> None:
    chance = random.Random(seed)

    async def play() -> int:
        store = Store()
        group = [Candidate(store, name) for name in "abc"]
        led = 0
        for _ in range(150):
            for candidate in group:
                if chance.random() < trouble:
                    candidate.network.mishaps = [chance.choice([m for m in Mishap if m is not Mishap.HANGS])]
                await candidate.time.advance(0.5)
                leaders = [each for each in group if each.leads]
                assert len(leaders) <= 1
                led += len(leaders)
        for candidate in group:
            await candidate.stop()
        return led

    led = asyncio.run(play())
    assert led > 0 or trouble > 0.5


def test_a_container_started_again_in_its_pod_is_the_same_candidate() -> None:
    assert candidate_identity({"POD_NAME": "robotapp-operator-abc"}) == "robotapp-operator-abc"


def test_outside_of_a_pod_two_processes_of_one_host_are_two_candidates() -> None:
    assert candidate_identity({}) != candidate_identity({})
