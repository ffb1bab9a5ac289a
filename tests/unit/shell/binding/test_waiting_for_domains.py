"""Hundreds of bare pods may wait for one pool: only an id that is given back wakes them, and no node is looked for in vain."""

from tests.support.scheduler.placing import Rig
from tests.support.scheduling import make_info

from robotapp_api.model.names import PodReason
from robotapp_claims.rules.identity import device_spec, domain_spec, holder_of_pod
from robotapp_claims.rules.objects import Claim, Meta
from robotapp_scheduler.core.cycle.diagnosis import DEVICE_PLUGIN, FULL_POOL
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.handle import Readiness, Reserved
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.shell.process.loop import POOLS_S

HOLDER = holder_of_pod(namespace="a", name="talker", uid="t")
TEXT = "3 of 3 domain ids of pool default are claimed"
FULL = Reserved(Readiness.WAIT, reason=PodReason.WAITING_FOR_DOMAIN, message=TEXT)
DOMAIN = Claim(
    metadata=Meta(name="dds.default.c.7"),
    spec=domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=7, holder=HOLDER),
)
DEVICE = Claim(
    metadata=Meta(name="dev.n.can-can0"),
    spec=device_spec(node="n", device_type="can", device_id="can-can0", identity="", holder=HOLDER),
)


def made(claim: Claim) -> Event:
    return Event("robotclaims", Change.CLAIMS, new=claim)


def gone(claim: Claim) -> Event:
    return Event("robotclaims", Change.CLAIMS, old=claim)


async def waiting(count: int = 1) -> Rig:
    """So many bare pods were told once that the pool is full, and may be tried again."""
    rig = Rig()
    rig.io.reservations.extend([FULL] * count)
    for number in range(count):
        rig.show(f"p{number}", wishes=True)
        await rig.turn()
    assert rig.core.queue.pending()["unschedulable"] == count
    rig.now_s += 20
    return rig


async def everybody_in_turn(rig: Rig) -> None:
    """A domain was given back, and seconds pass."""
    rig.core.queue.move(gone(DOMAIN))
    for _ in range(5):
        await rig.turn()
        rig.now_s += 1
        rig.core.queue.tick()
    await rig.turn()


async def test_only_a_domain_that_is_given_back_brings_the_pod_back_and_a_look_at_the_pools_now_and_then() -> None:
    rig = await waiting()
    queue = rig.core.queue
    for event in (made(DOMAIN), made(DEVICE), gone(DEVICE), Event("pods", Change.POD_REMOVED, old=make_info("q").pod)):
        assert queue.move(event) == 0
    assert queue.move(gone(DOMAIN)) == 1
    await rig.turn()
    assert [name for name, *_ in rig.io.asked] == ["p0"]
    rig = await waiting()
    rig.now_s += POOLS_S
    rig.loop.tick()
    await rig.turn()
    assert [name for name, *_ in rig.io.asked] == ["p0"]


async def test_while_none_is_free_the_pods_go_back_with_the_same_words_and_nothing_is_decided() -> None:
    rig = await waiting(5)
    rig.io.full, rig.said.lines = FULL, []
    decided = rig.core.schedule
    rig.core.schedule = None  # type: ignore[method-assign,assignment]
    await everybody_in_turn(rig)
    rig.core.schedule = decided  # type: ignore[method-assign]
    assert rig.said.lines == [(PodReason.WAITING_FOR_DOMAIN, f"p{number}", TEXT) for number in range(5)]
    assert rig.core.queue.pending()["unschedulable"] == 5
    rig.io.full, rig.now_s = None, rig.now_s + 20
    await everybody_in_turn(rig)
    assert len(rig.io.asked) == 5


async def test_an_id_that_is_given_back_is_tried_by_one_of_those_who_wait_and_by_the_others_while_seconds_pass() -> (
    None
):
    rig = await waiting(20)
    rig.io.full = FULL
    rig.core.queue.move(gone(DOMAIN))
    tried = []
    for _ in range(6):
        rig.said.lines = []
        await rig.turn()
        tried.append(len(rig.said.lines))
        rig.now_s += 1
        rig.core.queue.tick()
    assert tried == [1, 2, 4, 8, 5, 0]


async def test_the_pod_that_waits_longest_among_equals_is_the_first_to_try() -> None:
    rig = await waiting(3)
    for name in ("p0", "p1", "p2"):
        rig.core.queue.move(gone(DOMAIN))
        await rig.turn()
        assert [asked for asked, *_ in rig.io.asked][-1] == name


async def test_a_pod_whose_device_is_free_again_is_not_decided_while_no_domain_is() -> None:
    rig = await waiting()
    rig.show("p1", wishes=True)
    (queued,) = rig.core.queue.pop()
    rig.core.queue.requeue(queued, Rejection(frozenset({DEVICE_PLUGIN, "HardwareAffinityFilter"})))
    rig.now_s, rig.io.full, rig.said.lines = rig.now_s + 20, FULL, []
    rig.core.queue.activate(["uid-p1"])
    await rig.turn()
    assert rig.io.asked == []
    assert rig.said.lines == [(PodReason.WAITING_FOR_DOMAIN, "p1", TEXT)]
    waits = rig.core.queue.get("uid-p1")
    assert waits is not None
    assert waits.rejected_by == {FULL_POOL}
