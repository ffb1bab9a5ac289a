"""`scripts/bench teleop` from rows made by hand."""

import pytest
from tests.bench import teleop

from ros_nodes.trips import SENT, TRIP, Row


def rows(rtt_us: int, count: int = 500) -> list[Row]:
    found = []
    for number in range(count):
        at_us = number * 20_000
        found += [Row(SENT, number, at_us), Row(TRIP, number, at_us + rtt_us, rtt_us)]
    return found


def test_the_apps_of_a_scheduler_are_counted_together() -> None:
    told = {"one": ("edge-1", rows(4000, 520)), "two": ("cloud-1", rows(60_000))}
    outcome = teleop._outcome("x", told)
    assert outcome.nodes == {"one": "edge-1", "two": "cloud-1"}
    assert outcome.missed_share == pytest.approx(0.5, abs=0.03)
    assert (outcome.p50_us, outcome.p95_us) == (4000, 60_000)


def test_a_scheduler_without_any_command_missed_all() -> None:
    assert teleop._outcome("x", {}).missed_share == 1.0


def test_the_report_names_scheduler_figures_and_places(capsys: pytest.CaptureFixture[str]) -> None:
    teleop.report([teleop._outcome("ours", {"one": ("edge-1", rows(4000))})])
    assert capsys.readouterr().out.splitlines()[1].split() == ["ours", "4.0", "4.0", "4.0", "0.0%", "edge-1"]


def test_robots_side_is_pinned_and_the_operators_kept_off_it() -> None:
    app = teleop._app("a", "default-scheduler")
    operator, robot = app["spec"]["components"]
    assert operator["separateFrom"] == ["robot"]
    assert robot["nodeSelector"] == {"kubernetes.io/hostname": "robot-1"}
    assert app["spec"]["schedulerName"] == "default-scheduler"
