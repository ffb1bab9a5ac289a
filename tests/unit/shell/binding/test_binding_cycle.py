import asyncio
from typing import Any

import pytest
from tests.support.scheduler.placing import Rig
from tests.support.scheduler.pod_groups import pod_group

from robotapp_api.model.names import Label, PodReason
from robotapp_scheduler.core.api.core_v1 import ClaimReference
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Readiness, Reserved
from robotapp_scheduler.core.pods.pod_group_index import COSCHEDULING, POD_GROUP_LABEL, GroupRef
from robotapp_scheduler.shell.process.loop import IN_FLIGHT, SLICE_S


async def test_a_pod_is_decided_assumed_bound_and_leaves_the_queue() -> None:
    rig = Rig()
    rig.show()
    await rig.turn()
    ((name, node, grants, version),) = rig.io.asked
    assert (name, grants, version) == ("p", {}, "")
    assert rig.said.lines == [("scheduled", "p", node)]
    assert rig.core.cluster.placed["uid-p"].node == node
    assert len(rig.core.queue) == 0
    assert rig.count("scheduled") == 1


async def test_who_states_a_budget_to_nothing_is_told_when_the_pod_is_bound() -> None:
    rig = Rig()
    rig.show(annotations={"scheduler.robotics.io/policies": '{"latency_budget": "30ms"}'})
    await rig.turn()
    assert rig.said.lines[-1][0] == "scheduled"
    assert "has no effect, because it has no other end: write master_node" in rig.said.more


async def test_without_nodes_the_pod_waits_with_upstreams_text_and_a_node_brings_it_back() -> None:
    rig = Rig(nodes=0)
    rig.show()
    await rig.turn()
    assert rig.said.lines == [("Unschedulable", "p", "no nodes available to schedule pods")]
    assert rig.core.queue.pending()["unschedulable"] + rig.core.queue.pending()["backoff"] == 1


@pytest.mark.parametrize("result", [BindResult.GONE, BindResult.TAKEN])
async def test_a_pod_that_is_gone_or_taken_frees_its_room_and_is_not_tried_again(result: BindResult) -> None:
    rig = Rig()
    rig.io.binds.append(BindOutcome(result))
    rig.show()
    await rig.turn()
    assert rig.core.cluster.placed == {}
    assert len(rig.core.queue) == 0
    assert rig.said.lines == []


async def test_a_failed_bind_frees_the_room_tells_why_and_retries_after_back_off() -> None:
    rig = Rig()
    rig.io.binds.append(BindOutcome(BindResult.FAILED, "boom"))
    rig.show()
    await rig.turn()
    ((reason, _, message),) = rig.said.lines
    assert reason == PodReason.SCHEDULER_ERROR
    assert "boom" in message
    assert rig.core.cluster.placed == {}
    assert rig.core.queue.pending()["backoff"] == 1
    rig.now_s += 3
    rig.loop.tick()
    await rig.turn()
    assert rig.said.lines[-1][0] == "scheduled"


async def test_who_leads_no_longer_decides_nothing_and_says_nothing_about_what_was_in_flight() -> None:
    rig = Rig()
    rig.io.binds.append(BindOutcome(BindResult.DEPOSED))
    rig.show()
    await rig.turn()
    assert (rig.said.lines, rig.core.cluster.placed, len(rig.core.queue)) == ([], {}, 1)
    rig.leads = False
    rig.show("q")
    rig.now_s += 3
    rig.loop.tick()
    await rig.turn()
    assert [asked[0] for asked in rig.io.asked] == ["p"]
    assert rig.core.queue.pending()["active"] == 2


async def test_a_pod_deleted_while_its_bind_failed_does_not_come_back() -> None:
    rig = Rig()

    def vanish() -> BindOutcome:
        rig.waiting.pop("uid-p")
        rig.core.queue.delete("uid-p")
        return BindOutcome(BindResult.FAILED, "boom")

    rig.io.binds.append(vanish)
    rig.show()
    await rig.turn()
    assert len(rig.core.queue) == 0
    assert rig.said.lines == []


async def test_a_pod_that_changed_its_group_while_its_bind_failed_belongs_to_the_new_one() -> None:
    """News of an assumed pod is left aside until it is known what became of it."""
    rig = Rig()
    rig.core.cluster.pod_groups.apply(pod_group("team", min_member=1), COSCHEDULING)

    def relabelled() -> BindOutcome:
        rig.show(labels={POD_GROUP_LABEL: "team"})
        return BindOutcome(BindResult.FAILED, "boom")

    rig.io.binds.append(relabelled)
    rig.show()
    await rig.turn()
    team = GroupRef(COSCHEDULING, "a", "team")
    queued = rig.core.queue.get("uid-p")
    assert queued is not None
    assert (queued.group, rig.core.cluster.pod_groups.ready(team)) == (team, 1)


async def test_a_bug_on_the_way_never_leaves_a_pod_assumed() -> None:
    rig = Rig()
    rig.io.binds.append(RuntimeError("bug"))
    rig.show()
    await rig.turn()
    assert rig.core.cluster.placed == {}
    assert rig.core.queue.pending()["backoff"] == 1
    assert rig.said.lines[0][0] == PodReason.SCHEDULER_ERROR


async def test_a_bind_check_that_meets_a_bug_returns_every_pod_of_the_batch_to_the_queue(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rig = Rig()
    rig.io.domains = ValueError("unreadable")
    await rig.carry_out("p", "q")
    assert rig.io.asked == []
    assert rig.core.cluster.placed == {}
    assert rig.core.queue.pending()["backoff"] == 2
    assert [line[:2] for line in rig.said.lines] == [(PodReason.SCHEDULER_ERROR, name) for name in ("p", "q")]
    assert any(record.exc_info for record in caplog.records)


async def test_a_pod_that_cannot_even_be_abandoned_does_not_keep_its_batch_assumed() -> None:
    rig = Rig()
    rig.io.domains = ValueError("unreadable")
    rig.said.broken_for = "p"
    await rig.carry_out("p", "q")
    assert rig.core.cluster.placed == {}
    assert [line[1] for line in rig.said.lines] == ["q"]


async def test_a_pod_that_cannot_even_be_abandoned_does_not_cancel_the_binds_of_its_batch() -> None:
    rig = Rig()
    rig.io.reservations.append(RuntimeError("bug"))
    rig.said.broken_for = "p"
    await rig.carry_out("p", "q")
    assert [line[:2] for line in rig.said.lines] == [("scheduled", "q")]
    assert set(rig.core.cluster.placed) == {"uid-q"}


async def test_a_device_lost_at_reserve_leads_to_the_next_node_in_the_same_cycle() -> None:
    rig = Rig()
    rig.io.reservations.append(Reserved(Readiness.BUSY, reason="DeviceBusy", message="held"))
    rig.show(wishes=True)
    await rig.turn()
    assert len(rig.io.asked) == 1
    assert [line[0] for line in rig.said.lines] == ["scheduled"]


async def test_when_every_node_has_lost_its_device_the_pod_waits_and_the_holder_is_named() -> None:
    rig = Rig()
    busy = Reserved(Readiness.BUSY, reason="DeviceBusy", message="device can-can0 on n0 is held by a/drv")
    rig.io.reservations.extend([busy, busy])
    rig.show(wishes=True)
    await rig.turn()
    assert rig.io.asked == []
    assert rig.core.cluster.placed == {}
    assert ("DeviceBusy", "p", busy.message) in rig.said.lines
    assert rig.said.lines[0][0] == "Unschedulable"


async def test_grants_and_version_of_the_reservation_go_into_the_bind() -> None:
    rig = Rig()
    granted = {"granted.robotics.io/devices": "can-can0"}
    rig.io.reservations.append(Reserved(Readiness.READY, annotations=granted, resource_version="9"))
    rig.show(wishes=True)
    await rig.turn()
    assert rig.io.asked[0][2:] == (granted, "9")


async def test_a_pod_whose_version_moved_is_reserved_and_bound_again_at_once() -> None:
    rig = Rig()
    granted = {"granted.robotics.io/devices": "can-can0"}
    for version in ("9", "10"):
        rig.io.reservations.append(Reserved(Readiness.READY, annotations=granted, resource_version=version))
    rig.io.binds.append(BindOutcome(BindResult.CHANGED, "version"))
    rig.show(wishes=True)
    await rig.turn()
    assert [asked[3] for asked in rig.io.asked] == ["9", "10"]
    assert rig.said.lines[-1][0] == "scheduled"


async def test_many_pods_are_bound_at_the_same_time_each_once() -> None:
    rig = Rig(nodes=30)
    for index in range(200):
        rig.show(f"p{index}")
    await rig.turn()
    for _ in range(10):
        await rig.turn()
    names = [asked[0] for asked in rig.io.asked]
    assert sorted(names) == sorted({f"p{index}" for index in range(200)})


async def test_only_so_many_pods_are_on_their_way_at_once_and_each_answer_makes_room_for_one() -> None:
    rig = Rig(nodes=20)
    sent: list[Any] = []
    rig.io.send = lambda _pod, _node, told: sent.append(told)  # type: ignore[method-assign]  # answers when the test says
    for index in range(IN_FLIGHT + 9):
        rig.show(f"p{index}")
    await rig.turn()
    assert len(sent) == IN_FLIGHT
    for told in sent[:3]:
        told(None)
    await rig.turn()
    assert len(sent) == IN_FLIGHT + 3


async def test_between_decisions_that_take_long_what_arrives_has_its_turn() -> None:
    rig = Rig(nodes=20)
    decide = rig.core.schedule

    def slowly(batch: Any, **options: Any) -> Any:
        rig.now_s += SLICE_S / 4
        return decide(batch, **options)

    rig.core.schedule = slowly  # type: ignore[method-assign]  # time that passes while the core decides
    for index in range(20):
        rig.show(f"p{index}")
    task = asyncio.create_task(rig.loop.run())
    seen = []
    for _ in range(4):
        await asyncio.sleep(0)
        seen.append(len(rig.io.asked))
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert seen == [4, 8, 12, 16]


async def test_a_stopped_loop_finishes_what_is_in_flight_and_takes_nothing_new() -> None:
    rig = Rig()
    rig.show()
    task = asyncio.create_task(rig.loop.run())
    await rig.io.started.wait()
    rig.loop.stop()
    rig.show("late")
    await task
    await rig.loop.drain(1.0)
    assert [line[1] for line in rig.said.lines] == ["p"]
    assert len(rig.core.queue) == 1


async def test_volumes_are_bound_before_the_pod_is() -> None:
    rig = Rig()
    rig.with_volumes("p")
    rig.volumes.ready.clear()
    rig.show()
    await rig.turn()
    assert rig.volumes.asked == ["p"]
    assert rig.io.asked == []
    assert rig.said.nominated == {"p": rig.core.cluster.placed["uid-p"].node}
    rig.volumes.ready.set()
    await rig.turn()
    assert [name for name, *_ in rig.io.asked] == ["p"]
    assert [what for what, *_ in rig.said.lines] == ["scheduled"]


async def test_volumes_that_cannot_be_bound_send_the_pod_back_with_the_reason() -> None:
    rig = Rig()
    rig.with_volumes("p")
    rig.volumes.trouble = "binding volumes: context deadline exceeded"
    rig.show()
    await rig.turn()
    assert rig.io.asked == []
    text = 'running PreBind plugin "VolumeBinding": binding volumes: context deadline exceeded'
    assert rig.said.lines == [(PodReason.SCHEDULER_ERROR, "p", text)]
    assert rig.said.nominated == {"p": ""}
    assert rig.core.cluster.placed == {}
    assert rig.core.queue.pending()["backoff"] == 1
    assert rig.count("error") == 1


async def test_pods_that_wait_for_volumes_leave_the_binds_of_others_alone() -> None:
    rig = Rig(nodes=20)
    names = [f"slow-{i}" for i in range(100)]
    rig.with_volumes(*names)
    rig.volumes.ready.clear()
    for name in (*names, "plain"):
        rig.show(name)
    for _ in range(4):
        await rig.turn()
    assert len(rig.volumes.asked) == len(names)
    assert [name for name, *_ in rig.io.asked] == ["plain"]
    rig.volumes.ready.set()
    for _ in range(4):
        await rig.turn()
    assert len(rig.io.asked) == len(names) + 1


async def test_a_pod_that_was_granted_something_is_read_again_after_its_volumes_took_their_time() -> None:
    rig = Rig()
    rig.with_volumes("p")
    old, new = (Reserved(Readiness.READY, annotations={"granted": "x"}, resource_version=v) for v in ("7", "8"))
    rig.io.reservations.extend((old, new))
    rig.show(wishes=True)
    await rig.turn()
    assert rig.volumes.asked == ["p"]
    assert [version for *_, version in rig.io.asked] == ["8"]


async def test_the_loop_names_the_pods_that_it_decides_about_while_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()
    seen: list[list[str]] = []

    def schedule(*_: Any, **__: Any) -> Any:
        seen.append([queued.info.name for queued in rig.loop.deciding])
        raise ZeroDivisionError

    monkeypatch.setattr(rig.core, "schedule", schedule)
    rig.show("p")
    rig.loop._decide(rig.core.queue.pop())
    assert seen == [["p"]]
    assert rig.loop.deciding == ()


async def test_a_plain_pod_is_bound_without_a_task_that_waits_and_a_drain_waits_for_its_answer() -> None:
    rig = Rig()
    rig.show()
    rig.loop._decide(rig.core.queue.pop())
    assert (rig.loop._sent, rig.loop._tasks) == (1, set())
    assert repr(rig.loop).startswith("<SchedulerLoop 1 batches in flight")
    await rig.loop.drain(1.0)
    assert (rig.loop._sent, rig.said.lines[-1][0]) == (0, "scheduled")


@pytest.mark.parametrize(
    ("spec", "plain"),
    [
        ({}, True),
        ({"wishes": True}, False),
        ({"labels": {str(Label.APP_UID): "app-1"}}, False),
        ({"resource_claims": (ClaimReference(name="gpu"),)}, False),
    ],
)
async def test_only_a_pod_that_needs_nothing_before_its_bind_is_plain(spec: dict[str, Any], plain: bool) -> None:
    rig = Rig()
    rig.show(**spec)
    (decision,) = rig.core.schedule(rig.core.queue.pop())
    assert rig.loop._binding_cycle.is_plain(decision) is plain


@pytest.mark.parametrize("breaks", ["send", "scheduled"])
async def test_a_bug_on_the_way_of_a_plain_pod_puts_it_back_and_gives_its_slot_free(
    breaks: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig()

    def bug(*_args: object) -> None:
        raise RuntimeError("bug")

    with monkeypatch.context() as patched:
        patched.setattr(rig.io if breaks == "send" else rig.said, breaks, bug)
        rig.show()
        await rig.turn()
    assert rig.loop._sent == 0
    assert rig.core.cluster.placed == {}
    if breaks == "send":
        assert rig.core.queue.pending()["backoff"] == 1
    rig.now_s += 3
    rig.loop.tick()
    rig.show("q")
    await rig.turn()
    assert ("scheduled", "q") in [line[:2] for line in rig.said.lines]


async def test_a_bug_after_a_bind_in_doubt_puts_the_pod_back() -> None:
    rig = Rig()
    rig.io.binds.append(RuntimeError("bug"))
    rig.show()
    await rig.turn()
    assert (rig.loop._sent, rig.core.cluster.placed) == (0, {})
    assert rig.core.queue.pending()["backoff"] == 1
