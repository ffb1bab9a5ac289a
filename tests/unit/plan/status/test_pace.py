"""When a status may be written."""

from typing import Any

import pytest

from robotapp_operator.plan.status.pace import (
    BURST,
    CROWD_REST_S,
    LONGEST_START_S,
    MOST_START_REST_S,
    PROGRESS_REST_S,
    SETTLED_S,
    START_REST_S,
    START_S,
    STILL_S,
    URGENT_REST_S,
    Bucket,
    Crowd,
    Writing,
    is_progress,
    is_urgent,
)


def writes(seconds: int, *, edges: int = 0) -> list[float]:
    """When an app that changes all the time is written, looked at ten times per second."""
    bucket, found = Bucket(), []
    for tick in range(seconds * 10):
        now_s = 1000 + tick / 10
        if bucket.wait_s(now_s, edges=edges) <= 0:
            bucket.take(now_s, edges=edges)
            found.append(now_s)
    return found


def test_a_burst_and_then_one_write_per_second() -> None:
    found = writes(10)
    assert found[:BURST] == [1000, 1000.1, 1000.2]
    assert found[BURST:] == pytest.approx([1001 + number for number in range(9)])


def test_the_largest_apps_are_written_every_four_seconds() -> None:
    assert writes(40, edges=256)[BURST:] == pytest.approx([1004 + 4 * number for number in range(9)], abs=0.11)


def test_a_first_write_that_cannot_wait_is_paid_for_later() -> None:
    bucket = Bucket()
    for _ in range(BURST + 1):
        bucket.take(1000, edges=0)
    assert bucket.wait_s(1000, edges=0) == pytest.approx(2.0)


def test_writes_that_only_show_progress_come_ever_more_seldom_and_an_urgent_one_at_once() -> None:
    bucket, found = Bucket(), []
    bucket.take(1000, edges=0)
    for tick in range(400):
        now_s = 1000 + tick / 10
        if bucket.wait_s(now_s, edges=0, progress=True) <= 0:
            bucket.take(now_s, edges=0, progress=True)
            found.append(now_s)
    assert found == pytest.approx([1001, 1006, 1021, 1036], abs=0.11)
    assert bucket.wait_s(1036.1, edges=0) == 0
    bucket.take(1036.1, edges=0)
    assert bucket.wait_s(1036.1, edges=0, progress=True) == pytest.approx(START_REST_S[0])


def test_the_more_apps_start_the_longer_mere_progress_waits_but_never_for_ever() -> None:
    bucket = Bucket()
    bucket.take(1000, edges=0)
    for starting, rest_s in ((1, START_REST_S[0]), (20, CROWD_REST_S * 20), (1000, MOST_START_REST_S)):
        assert bucket.wait_s(1000, edges=0, progress=True, starting=starting) == pytest.approx(rest_s)
        assert bucket.wait_s(1000, edges=0, starting=starting) == 0


def test_an_instance_in_a_crowd_shows_its_progress_later_and_what_is_urgent_as_soon_as_ever() -> None:
    due = {"moved": True, "urgent": False, "ready": False}
    assert Writing(written_s=1000).due_s(1000, **due, starting=1) == 1000 + STILL_S
    assert Writing(written_s=1000).due_s(1000, **due, starting=1000) == 1000 + MOST_START_REST_S
    assert Writing(written_s=990).due_s(1000, moved=True, urgent=True, ready=True, starting=1000) == 1000


def test_apps_start_together_until_all_have_arrived_are_gone_or_show_nothing_new_for_too_long() -> None:
    crowd = Crowd()
    for number in range(3):
        assert crowd.note(f"uid-{number}", starts=True, begins=True, now_s=1000 + number) == number + 1
    assert crowd.note("uid-0", starts=True, begins=False, now_s=1004) == 3
    crowd.note("uid-0", starts=False, begins=False, now_s=1005)
    assert repr(crowd) == "Crowd(2)"
    crowd.leave("uid-1")
    crowd.leave("uid-1")
    assert repr(crowd) == "Crowd(1)"
    assert crowd.note("uid-2", starts=True, begins=True, now_s=1050) == 2  # edited: it begins anew
    assert crowd.size(1050 + MOST_START_REST_S) == 1
    assert crowd.size(1050 + START_S) == 0


def test_a_crowd_that_gets_ready_counts_whole_until_few_are_left_or_for_as_long_as_the_longest_pause() -> None:
    crowd, ready_s = Crowd(), 1040
    for number in range(200):
        crowd.note(f"uid-{number}", starts=True, begins=True, now_s=1000)
    sizes = [crowd.note(f"uid-{number}", starts=False, begins=False, now_s=ready_s) for number in range(180)]
    assert sizes == [200] * 179 + [20]
    assert crowd.take_few() == {f"uid-{number}" for number in range(180, 200)}
    assert crowd.take_few() == set()

    gone = Crowd()
    for number in range(200):
        gone.note(f"uid-{number}", starts=True, begins=True, now_s=1000)
    for number in range(175):
        gone.leave(f"uid-{number}")
    assert gone.size(1001) == 25

    slow = Crowd()
    for number in range(200):
        slow.note(f"uid-{number}", starts=True, begins=True, now_s=1000)
    leaving_s = (10, 10 + MOST_START_REST_S, 11 + MOST_START_REST_S)
    left = [
        slow.note(f"uid-{number}", starts=False, begins=False, now_s=1000 + s) for number, s in enumerate(leaving_s)
    ]
    assert left == [200, 200, 198]


def test_on_a_slow_machine_a_crowd_stays_one_for_longer_than_a_minute() -> None:
    crowd = Crowd()
    for second in range(0, 180, 30):  # each step of a start comes after half a minute
        for number in range(60):
            crowd.note(f"uid-{number}", starts=True, begins=second == 0, now_s=1000 + second)
    assert crowd.size(1179) == 60
    assert crowd.size(1150 + START_S) == 0
    assert crowd.note("uid-0", starts=True, begins=False, now_s=1150 + START_S) == 0


def test_an_app_whose_start_never_ends_does_not_count_for_ever() -> None:
    crowd, seconds = Crowd(), range(0, int(2 * LONGEST_START_S), 10)
    sizes = {second: crowd.note("uid-0", starts=True, begins=second == 0, now_s=1000 + second) for second in seconds}
    assert sizes == {second: int(second < LONGEST_START_S) for second in seconds}
    assert crowd.note("uid-0", starts=True, begins=True, now_s=1000 + 2 * LONGEST_START_S) == 0  # edited: no new start
    assert crowd.note("uid-0", starts=False, begins=False, now_s=2300) == 0  # Ready
    assert crowd.note("uid-0", starts=True, begins=True, now_s=2400) == 1


def test_however_often_an_app_is_edited_what_came_of_it_is_told_after_two_periods() -> None:
    bucket = Bucket()
    for edit in range(600):  # each is told at once
        bucket.take(1000 + edit, edges=256)
    assert bucket.wait_s(1600, edges=256) <= 2 * 4


def test_neither_an_app_that_is_refused_nor_one_whose_start_was_not_seen_counts_as_starting() -> None:
    crowd = Crowd()
    assert crowd.note("uid-1", starts=False, begins=True, now_s=1000) == 0
    assert crowd.note("uid-2", starts=True, begins=False, now_s=1000) == 0


def status(phase: str = "Pending", **conditions: tuple[str, str]) -> dict[str, Any]:
    listed = [{"type": kind, "status": state, "reason": reason} for kind, (state, reason) in conditions.items()]
    return {"phase": phase, "conditions": listed}


NEW = status(Ready=("Unknown", "Pending"), Accepted=("Unknown", "Pending"), BudgetMet=("Unknown", "Pending"))


@pytest.mark.parametrize(
    ("before", "after", "urgent"),
    [
        (NEW, status("Placing", Ready=("False", "ComponentsNotReady"), Accepted=("True", "Accepted")), False),
        (NEW, status("Placing", Ready=("False", "Unschedulable")), False),
        (NEW, status("Pending", BudgetMet=("True", "NoBudget")), False),
        (NEW, status("Running", Ready=("True", "AllComponentsReady")), True),
        (NEW, status("Pending", Ready=("False", "CrashLoop")), True),
        (NEW, status("Pending", Accepted=("False", "RobotNodeUnclear")), True),
        (status("Running"), status("Degraded"), True),
        (status("Running"), status("Offline"), True),
        (status("Degraded"), status("Placing"), False),
        (
            status("Running", Ready=("True", "AllComponentsReady")),
            status("Placing", Ready=("False", "ComponentsNotReady")),
            True,
        ),
        (
            status("Running", BudgetMet=("True", "WithinBudget")),
            status("Running", BudgetMet=("False", "BudgetExceeded")),
            True,
        ),
        (
            status("Running", BudgetMet=("False", "BudgetExceeded")),
            status("Running", BudgetMet=("True", "WithinBudget")),
            True,
        ),
        (status(Accepted=("False", "RobotNodeUnclear")), status(Accepted=("True", "Accepted")), True),
    ],
)
def test_what_somebody_waits_for_is_urgent(before: dict[str, Any], after: dict[str, Any], urgent: bool) -> None:
    assert is_urgent(before, after) is urgent


def progress(writing: Writing, now_s: float, *, moved: bool = True) -> float:
    return writing.due_s(now_s, moved=moved, urgent=False, ready=False)


def test_progress_waits_longer_from_step_to_step() -> None:
    writing = Writing()
    writing.wrote(0, urgent=True)
    first, further = PROGRESS_REST_S
    assert progress(writing, first - 1) == first
    writing.wrote(first, urgent=False)
    assert progress(writing, first + further - 1) == first + further
    writing.wrote(first + further, urgent=False)
    assert progress(writing, first + 2 * further - 1) == first + 2 * further


def test_progress_that_has_come_to_a_halt_is_written_soon() -> None:
    writing = Writing()
    writing.wrote(0, urgent=False)
    assert progress(writing, 2) == 2 + STILL_S
    assert progress(writing, 3, moved=False) == 2 + STILL_S
    assert progress(writing, 4) == 4 + STILL_S


def test_a_start_that_moves_all_the_time_is_written_three_times_within_a_minute() -> None:
    writing, writes = Writing(), [0.0]
    writing.wrote(0, urgent=True)
    for tick in range(1, 600):
        now_s = tick / 10
        if progress(writing, now_s) <= now_s:
            writing.wrote(now_s, urgent=False)
            writes.append(now_s)
    assert len(writes) + 1 <= 3, "the created object, this, and that it is ready"


def test_readiness_is_written_at_once_and_a_failure_when_it_has_stood_for_a_moment() -> None:
    writing = Writing()
    writing.wrote(0, urgent=True)
    assert writing.due_s(10, moved=True, urgent=True, ready=True) == 10
    writing.same()
    assert writing.due_s(20, moved=True, urgent=True, ready=False) == 20 + SETTLED_S
    assert writing.due_s(20.4, moved=True, urgent=True, ready=False) == 20 + SETTLED_S, "counted from when it began"
    writing.wrote(20.5, urgent=True)
    assert writing.due_s(20.6, moved=True, urgent=True, ready=True) == 20.5 + URGENT_REST_S


def test_after_a_quiet_time_progress_is_prompt_again() -> None:
    writing = Writing()
    for now_s in (0, 15, 75):
        writing.wrote(now_s, urgent=False)
    assert writing.steps > 1
    assert progress(writing, 500) <= 500
    writing.wrote(500, urgent=False)
    assert progress(writing, 514) == 500 + PROGRESS_REST_S[0]


STARTED = {
    "Allocated": ("True", "Allocated"),
    "Placed": ("False", "WaitingForPods"),
    "Ready": ("False", "ComponentsNotReady"),
    "Progressing": ("True", "RollingOut"),
}


@pytest.mark.parametrize(
    ("phase", "changed", "progress"),
    [
        ("Placing", {}, True),
        ("Placing", {"Placed": ("True", "Placed"), "BudgetMet": ("True", "WithinBudget")}, True),
        ("Running", {"Ready": ("True", "AllComponentsReady")}, False),
        ("Placing", {"Placed": ("False", "Unschedulable")}, False),
        ("Placing", {"Placed": ("True", "FallbackUsed")}, False),
        ("Placing", {"Allocated": ("False", "DeviceBusy")}, False),
        ("Placing", {"Ready": ("False", "CrashLoop")}, False),
        ("Placing", {"Progressing": ("False", "NewerVersion")}, False),
        ("Degraded", {}, False),
    ],
)
def test_only_the_steps_of_a_normal_start_are_mere_progress(
    phase: str, changed: dict[str, tuple[str, str]], progress: bool
) -> None:
    assert is_progress(status("Placing", **STARTED), status(phase, **(STARTED | changed))) is progress


def test_devices_are_claimed_when_a_pod_is_bound_so_waiting_for_them_is_a_step_of_a_start() -> None:
    waits = STARTED | {"Allocated": ("False", "WaitingForDevices")}
    assert is_progress(status("Pending", **waits), status("Placing", **STARTED))
    busy = waits | {"Ready": ("False", "DeviceBusy")}
    assert not is_progress(status("Pending", **waits), status("Pending", **busy))


def test_a_domain_after_waiting_for_one_is_progress_and_its_refusal_is_not() -> None:
    waits = STARTED | {"Allocated": ("Unknown", "Pending")}
    assert is_progress(status("Pending", **waits), status("Placing", **STARTED))
    assert not is_progress(status("Pending", **waits), status("Pending", **waits, Stalled=("True", "FailedCreate")))


def test_the_end_of_a_refusal_is_no_mere_progress() -> None:
    refused = STARTED | {"Allocated": ("False", "ClaimConflict")}
    assert not is_progress(status("Placing", **refused), status("Placing", **STARTED))
