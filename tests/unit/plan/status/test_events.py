"""Events tell changes of state, once."""

import dataclasses
from datetime import date
from typing import Any

import pytest
from tests.support.factories import make_app

from robotapp_api.model.names import Condition, EventReason, Reason
from robotapp_operator.plan.status.events import NOT_ACCEPTED, NOT_ALLOCATED, TURNS, end_of_life, events_between


def status(**conditions: tuple[str, str, str]) -> dict[str, Any]:
    return {
        "conditions": [
            {"type": kind, "status": state, "reason": reason, "message": text}
            for kind, (state, reason, text) in conditions.items()
        ]
    }


def reasons(before: dict[str, Any], after: dict[str, Any], **domains: int) -> list[str]:
    return [item.reason.value for item in events_between(before, after, new_domains=domains)]


def test_new_domains_are_told_per_robot() -> None:
    (item,) = events_between({}, {}, new_domains={"amr-07": 7})
    assert (item.reason, item.note, item.warning) == (EventReason.DOMAIN_ALLOCATED, "robot amr-07: domain 7", False)
    assert events_between({}, {}, new_domains={"": 7})[0].note == "domain 7"
    (run,) = events_between({}, {}, new_domains={"1-0-5f3c2a91": 7}, kind="run")
    assert run.note == "run 1-0-5f3c2a91: domain 7"


def test_each_state_is_told_when_it_begins_and_not_again() -> None:
    bad = status(
        Accepted=("False", "InvalidSpec", "a"),
        Allocated=("False", "DomainExhausted", "b"),
        Ready=("False", "CrashLoop", "c"),
        BudgetMet=("False", "BudgetExceeded", "d"),
        Placed=("True", "Placed", "e"),
        Progressing=("False", "NewerVersion", "f"),
    )
    told = ["InvalidSpec", "DomainExhausted", "ChildFailed", "Placed", "NewerVersion", "BudgetExceeded"]
    assert reasons({}, bad) == told
    assert reasons(bad, bad) == []


@pytest.mark.parametrize(
    ("kind", "reason"), sorted((turn.kind, reason) for turn in TURNS if turn.event is None for reason in turn.reasons)
)
def test_what_is_told_under_its_own_reason_has_an_event_of_that_name(kind: Condition, reason: Reason) -> None:
    assert reason.value in reasons({}, status(**{kind.value: ("False", reason.value, "why")}))


@pytest.mark.parametrize("reason", sorted(NOT_ALLOCATED | NOT_ACCEPTED))
def test_a_refusal_is_told_under_its_own_reason(reason: Reason) -> None:
    kind = "Accepted" if reason in NOT_ACCEPTED else "Allocated"
    assert reasons({}, status(**{kind: ("False", reason.value, "why")})) == [reason.value]


def test_a_device_that_is_lost_is_told_and_so_is_its_return_but_not_that_it_is_not_needed_any_more() -> None:
    lost = status(Allocated=("False", "DeviceLost", "driver: device cam on edge-1 is gone: plug it in again"))
    back = status(Allocated=("True", "Allocated", "domain 7; 1 of 1 device"))
    assert reasons(back, lost) == ["DeviceLost"]
    (item,) = events_between(lost, back, new_domains={}, there=["device can on edge-1", "device cam on edge-1"])
    assert (item.reason, item.warning) == (EventReason.DEVICE_RETURNED, False)
    assert item.note == "device cam on edge-1 is back: domain 7; 1 of 1 device"
    assert reasons(lost, status(Allocated=("Unknown", "Pending", ""))) == []


def test_devices_that_were_claimed_are_told_when_the_app_holds_all_of_them_and_not_again() -> None:
    waits = status(Allocated=("False", "WaitingForDevices", "1 of 2 devices are claimed"))
    text = "domain 7; 2 of 2 devices reserved"
    held = {**status(Allocated=("True", "Allocated", text)), "summary": {"devices": "2/2"}}
    for before in ({}, waits):
        (item,) = events_between(before, held, new_domains={})
        assert (item.reason, item.note, item.warning) == (EventReason.DEVICE_CLAIMED, text, False)
    assert reasons(held, held) == []
    assert reasons(waits, held | {"summary": {"devices": "0/2"}}) == [], "a suspended app holds none"
    assert reasons(waits, held | {"summary": {}}) == [], "it needs none"
    elsewhere = reasons(status(Allocated=("False", "DeviceLost", "device cam on edge-1 is gone")), held)
    assert elsewhere == ["DeviceClaimed"], "the lost one is not back: others were claimed"


@pytest.mark.parametrize("there", [(), ("device cam on edge-2",), ("device cam on edge-10",)])
def test_a_device_that_is_still_gone_has_not_returned_when_the_pod_moved_or_the_app_is_suspended(
    there: tuple[str, ...],
) -> None:
    lost = status(Allocated=("False", "DeviceLost", "driver: device cam on edge-1 is gone: plug it in again"))
    assert events_between(lost, status(Allocated=("True", "Allocated", "1 of 1")), new_domains={}, there=there) == []


def test_a_robot_out_of_reach_is_told() -> None:
    assert reasons({}, status(Ready=("False", "RobotOffline", "node n"))) == ["RobotOffline"]


def test_a_robot_not_ready_for_a_while_is_told_and_again_when_that_made_it_offline() -> None:
    lost = status(Ready=("False", "RobotNotReady", "node n"))
    assert reasons(status(Ready=("True", "AllComponentsReady", "")), lost) == ["RobotNotReady"]
    assert reasons(lost, status(Ready=("False", "RobotOffline", "node n"))) == ["RobotOffline"]


def test_a_refusal_by_all_nodes_is_told_on_the_app_itself() -> None:
    assert reasons({}, status(Placed=("False", "Unschedulable", "0 of 3 placed"))) == ["NodeRejected"]


def test_another_message_of_the_same_state_is_no_news() -> None:
    before = status(Placed=("True", "Placed", "on a"))
    assert reasons(before, status(Placed=("True", "Placed", "on b"))) == []


def test_ordinary_progress_is_no_news() -> None:
    assert (
        reasons({}, status(Ready=("False", "ComponentsNotReady", "0 of 3"), Allocated=("Unknown", "Pending", ""))) == []
    )


def test_a_dead_distribution_is_told_once_per_generation() -> None:
    app = make_app(ros={"distro": "iron"})
    found = end_of_life(app, {}, date(2026, 1, 1))
    assert found is not None
    assert found.reason == EventReason.EOL_DISTRO
    assert "2024-12-04" in found.note
    assert end_of_life(app, {"observedGeneration": 1}, date(2026, 1, 1)) is None
    assert end_of_life(dataclasses.replace(app, generation=2), {"observedGeneration": 1}, date(2026, 1, 1)) is not None
    assert end_of_life(app, {}, date(2024, 1, 1)) is None
    assert end_of_life(make_app(ros={"distro": "rolling"}), {}, date(2099, 1, 1)) is None


def test_a_fallback_that_was_used_is_told_once_and_not_as_a_warning() -> None:
    used = status(
        Placed=("True", "FallbackUsed", "2 of 2 components on a; given up: planner runs on tier Robot instead of Edge")
    )
    (item,) = events_between({}, used, new_domains={})
    assert (item.reason, item.warning) == (EventReason.FALLBACK_USED, False)
    assert "given up: planner runs on tier Robot" in item.note
    assert reasons(used, used) == []
