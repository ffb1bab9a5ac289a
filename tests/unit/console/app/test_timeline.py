"""Moves of components as a timeline."""

from dataclasses import dataclass

from tests.unit.console.objects import NOW_S, app, instance, snapshot, timestamp

from robotapp_console.views.app.page import EventRow, build_app
from robotapp_console.views.app.timeline import ANSWER_S, MOST_ENTRIES, MoveTime, build_timeline


@dataclass(frozen=True)
class Instance:
    name: str
    moves: tuple[MoveTime, ...]


def move(component: str, ago_s: float) -> MoveTime:
    return MoveTime(component, timestamp(NOW_S - ago_s))


def event(reason: str, note: str, ago_s: float) -> EventRow:
    return EventRow(timestamp(NOW_S - ago_s), "Normal", reason, note, 1)


def test_a_move_has_the_words_of_the_event_that_followed_it() -> None:
    note = "planner moved from edge-1 to edge-2: /odom to driver 61ms of 30ms before, 8ms expected"
    instances = [Instance("amr-07", (move("planner", 60), move("planner", 4000)))]
    newest, oldest = build_timeline(instances, [event("Rescheduled", note, 50)])
    assert (newest.subject, newest.text, newest.colour) == ("planner on amr-07", note, "good")
    assert (oldest.at, oldest.colour) == (timestamp(NOW_S - 4000), "idle")
    assert "its event is gone" in oldest.text


def test_two_moves_of_a_component_get_their_own_events() -> None:
    instances = [Instance("", (move("planner", 300), move("planner", 100)))]
    events = [
        event("Rescheduled", "planner moved from b to c", 90),
        event("Rescheduled", "planner moved from a to b", 290),
    ]
    assert [entry.text[-6:] for entry in build_timeline(instances, events)] == ["b to c", "a to b"]


def test_an_event_of_another_component_or_of_another_time_is_not_taken() -> None:
    instances = [Instance("", (move("planner", ANSWER_S + 100),))]
    events = [event("Rescheduled", "planner-2 moved from a to b", ANSWER_S), event("Rescheduled", "planner moved", 10)]
    subjects = [(entry.subject, entry.text) for entry in build_timeline(instances, events)]
    assert ("planner", "was evicted to start elsewhere; its event is gone") in subjects
    assert ("Rescheduled", "planner moved") in subjects


def test_what_led_to_a_move_stands_before_it_and_other_events_do_not() -> None:
    events = [
        event("BudgetExceeded", "/odom 61ms of 30ms", 70),
        event("DeviceReturned", "can0 is back", 30),
        event("DomainAllocated", "domain 7", 80),
    ]
    entries = build_timeline([Instance("", (move("planner", 60),))], events)
    assert [(entry.subject, entry.colour) for entry in entries] == [
        ("DeviceReturned", "good"),
        ("planner", "idle"),
        ("BudgetExceeded", "bad"),
    ]


def test_times_that_cannot_be_read_break_nothing_and_the_list_is_bounded() -> None:
    instances = [Instance("", (MoveTime("planner", "yesterday"), *(move("planner", i) for i in range(40))))]
    assert len(build_timeline(instances, [event("Rescheduled", "planner moved", 0)])) == MOST_ENTRIES


def test_the_page_collects_the_moves_of_its_instances() -> None:
    body = instance("teleop", "amr-07")
    body["status"]["moves"] = [{"component": "planner", "times": [timestamp(NOW_S)]}]
    view = build_app(snapshot(apps=[app("teleop")], instances=[body]), "default", "teleop")
    assert view is not None
    assert [entry.subject for entry in build_timeline(view.instances, ())] == ["planner on amr-07"]


def test_templates_that_wait_are_named_with_the_version_to_approve() -> None:
    body = app("teleop")
    message = "2 templates of a newer operator wait; annotate robotics.io/approve-update=0.2.0 to roll them"
    body["status"]["conditions"] = [
        {"type": "Progressing", "status": "False", "reason": "UpdateHeld", "message": message}
    ]
    view = build_app(snapshot(apps=[body]), "default", "teleop")
    assert view is not None
    assert view.approval == "0.2.0"
    assert build_app(snapshot(apps=[app("teleop")]), "default", "teleop").approval == ""  # type: ignore[union-attr]
