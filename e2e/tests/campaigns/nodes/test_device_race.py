"""`scripts/bench device_race` judges pods made by hand."""

import json
from dataclasses import asdict
from typing import Any

from campaigns.nodes import device_race
from campaigns.nodes.device_race import SCHEDULERS, Use

Json = dict[str, Any]


def pod(name: str, *, message: str = "", phase: str = "Succeeded", scheduler: str = SCHEDULERS[0]) -> Json:
    state = {"terminated": {"message": message}} if message else {}
    return {
        "metadata": {"name": name},
        "spec": {"schedulerName": scheduler, "nodeName": "robot-1"},
        "status": {"phase": phase, "containerStatuses": [{"state": state}]},
    }


def judge(*pods: Json, events: tuple[Json, ...] = ()) -> device_race.Result:
    return device_race.judge(pods, events, devices=2, kills=0, seconds=1.0)


def test_programs_that_take_turns_are_no_problem() -> None:
    result = judge(
        pod("a", message="/dev/ttyUSB0 10.0 12.5\n"),
        pod("b", message="/dev/ttyUSB0 12.5 13.0\n", scheduler=SCHEDULERS[1]),
        pod("c", message="/dev/ttyUSB1 11.0 12.0\n"),
    )
    assert result.problems == []
    assert result.ran == {SCHEDULERS[0]: 2, SCHEDULERS[1]: 1}
    assert (result.devices_used, result.median_use_s) == (2, 1.0)


def test_two_programs_at_one_device_at_the_same_moment_are_a_problem() -> None:
    result = judge(pod("a", message="/dev/ttyUSB0 10.0 12.5\n"), pod("b", message="/dev/ttyUSB0 12.4 13.0\n"))
    assert result.problems == ["robot-1 /dev/ttyUSB0: b had it from 12.4 on, a until 12.5"]


def test_a_short_use_within_a_long_one_does_not_hide_the_next() -> None:
    uses = [Use("long", "d", 0.0, 9.0), Use("short", "d", 1.0, 2.0), Use("next", "d", 5.0, 6.0)]
    assert len(device_race.find_overlaps(uses)) == 2


def test_a_pod_that_did_not_end_well_is_a_problem() -> None:
    waiting, foreign = pod("waiting", phase="Pending"), pod("foreign", phase="Failed", message="user-3 2\n")
    problems = judge(waiting, foreign).problems
    assert [line.partition(" ")[0] for line in problems] == ["waiting", "foreign"]
    assert "user-3 2" in problems[1]


def test_a_pod_that_was_refused_often_counts_once_with_its_scheduler() -> None:
    refused = {"involvedObject": {"name": "a"}, "message": f"device serial-1 of node robot-1 {device_race.REFUSED} b"}
    other = {"involvedObject": {"name": "a"}, "message": "pulled"}
    result = judge(pod("a", message="/dev/ttyUSB0 1 2", scheduler=SCHEDULERS[1]), events=(refused, refused, other))
    assert result.refused == {SCHEDULERS[1]: 1}


def test_every_device_has_a_serial_number_of_its_own() -> None:
    ids = [device.id for node in device_race.NODES for device in device_race.devices_of(node, 10)]
    assert len(set(ids)) == 20


def test_half_of_the_pods_are_of_each_scheduler() -> None:
    names = [device_race.user(number)["spec"]["schedulerName"] for number in range(6)]
    assert names == [*SCHEDULERS] * 3


def test_the_figures_of_a_race_can_be_written_as_json() -> None:
    assert json.loads(json.dumps(asdict(judge(pod("a", message="/dev/ttyUSB0 1 2")))))["ran"] == {SCHEDULERS[0]: 1}
