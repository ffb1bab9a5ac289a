"""`scripts/bench reference`: which runs a turn makes, and in which order."""

import itertools
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.reference.catalogue import GENERATIONS, SCENARIOS, SCHEDULERS, Fault
from campaigns.reference.trials.play import TRIALS
from campaigns.reference.turns import (
    ALL,
    OWN,
    Turn,
    choose_contenders,
    choose_faults,
    plan_placements,
    plan_trials,
    put_missing_first,
    within,
)

EVERY = list(SCENARIOS.values())


def plan_all(faults: str) -> list[Turn]:
    return plan_trials(EVERY, GENERATIONS, SCHEDULERS, faults)


def test_every_application_is_tried_under_both_schedulers_through_its_own_fault() -> None:
    turns = plan_all(OWN)
    assert Counter(turn.app for turn in turns) == {scenario.app(ros): 2 for scenario in EVERY for ros in GENERATIONS}
    assert {turn.app: turn.fault_text for turn in turns if turn.ros == 2} == {
        "teleop-ros2": "link cut 10 s",
        "navigation-ros2": "robot offline 60 s",
        "usb-sensor-ros2": "sensor unplugged 11 s",
        "fleet-ros2": "coordinator's pod killed",
        "detection-ros2": "detector's pod killed",
    }


@pytest.mark.parametrize("fault", Fault)
def test_a_fault_is_made_where_something_is_promised_of_it(fault: Fault) -> None:
    assert {turn.scenario.name for turn in plan_all(fault)} == {s.name for s in EVERY if fault in s.faults}
    assert {turn.fault for turn in plan_all(fault)} == {fault}


def test_all_faults_are_each_applications_own_and_the_others() -> None:
    faults = [Fault.LINK_CUT, Fault.ROBOT_OFFLINE, Fault.POD_KILLED]
    assert [*choose_faults(SCENARIOS["teleop"], 2, ALL)] == faults
    assert [*choose_faults(SCENARIOS["teleop"], 1, ALL)] == [*faults, Fault.MASTER_KILLED]
    assert TRIALS.keys() == SCENARIOS.keys()
    assert all(scenario.killed for scenario in EVERY if Fault.POD_KILLED in scenario.faults)


def test_schedulers_take_turns_in_being_first() -> None:
    turns = plan_placements([SCENARIOS["fleet"]], [2], SCHEDULERS, 2)
    assert [(turn.repetition, turn.contender.name) for turn in turns] == [
        (0, "robotapp"),
        (0, "kube-scheduler"),
        (1, "kube-scheduler"),
        (1, "robotapp"),
    ]
    assert [contender.name for contender in choose_contenders("kube-scheduler")] == ["kube-scheduler"]


@given(st.sets(st.integers(0, 39)))
def test_what_is_missing_comes_first_and_nothing_is_left_out(there: set[int]) -> None:
    turns = plan_placements(EVERY, GENERATIONS, SCHEDULERS, 2)
    ids = [id(turn) for turn in turns]
    ordered = put_missing_first(turns, lambda turn: ids.index(id(turn)) in there)
    numbers = [ids.index(id(turn)) for turn in ordered]
    assert numbers == [n for n in range(40) if n not in there] + sorted(there)


def test_no_run_begins_after_the_budget() -> None:
    times_s = itertools.count(0, 25)
    turns = plan_all(OWN)
    begun = [*within(turns, 1.0, clock=lambda: next(times_s))]
    assert begun == turns[:2]
