"""`scripts/bench teleop` from rows made by hand."""

import pytest

from campaigns.nodes import teleop
from campaigns.nodes.teleop import Outcome
from ros_nodes.trips import SENT, TRIP, Row


def rows(rtt_us: int, count: int = 500) -> list[Row]:
    found = []
    for number in range(count):
        at_us = number * 20_000
        found += [Row(SENT, number, at_us), Row(TRIP, number, at_us + rtt_us, rtt_us)]
    return found


def outcome(scheduler: str, told: dict[str, tuple[str, list[Row]]]) -> Outcome:
    return teleop.outcome(scheduler, told, deadline_us=teleop.DEADLINE_US, settle_us=teleop.SETTLE_US)


def test_the_apps_of_a_scheduler_are_counted_together() -> None:
    found = outcome("x", {"one": ("edge-1", rows(4000, 520)), "two": ("cloud-1", rows(60_000))})
    assert found.nodes == {"one": "edge-1", "two": "cloud-1"}
    assert found.missed_share == pytest.approx(0.5, abs=0.03)
    assert (found.p50_us, found.p95_us) == (4000, 60_000)


def test_a_scheduler_without_any_command_missed_all() -> None:
    found = outcome("x", {})
    assert found.missed_share == 1.0
    assert teleop.table([found])[1].split() == ["x", "1", "-", "-", "-", "100.0%", "(100.0%-100.0%)"]


def test_the_order_of_the_two_alternates() -> None:
    assert teleop.order(("A", "B"), 1) == ["A", "B"]
    assert teleop.order(("A", "B"), 3) == ["A", "B", "B", "A", "A", "B"]


def test_the_table_has_medians_with_least_and_most() -> None:
    runs = [outcome("ours", {"one": ("edge-1", rows(rtt_us))}) for rtt_us in (4000, 9000, 5000)]
    header, told = teleop.table(runs)
    assert header.startswith("medians (least to most)")
    assert told.split()[:4] == ["ours", "3", "5.0", "(4.0-9.0)"]
    assert teleop.as_json(runs)["median_least_most"]["ours"]["p50_us"] == (5000, 4000, 9000)


def test_a_run_is_told_in_a_line_with_its_places() -> None:
    assert teleop.line(outcome("ours", {"one": ("edge-1", rows(4000))})) == (
        "ours: p50 4.0 ms, p95 4.0 ms, p99 4.0 ms, missed 0.0%; operator sides on edge-1"
    )


def test_robots_side_is_pinned_and_the_operators_kept_off_it() -> None:
    app = teleop._app("a", "default-scheduler")
    operator, robot = app["spec"]["components"]
    assert operator["separateFrom"] == ["robot"]
    assert robot["template"]["spec"]["nodeSelector"] == {"kubernetes.io/hostname": "robot-1"}
    assert app["spec"]["schedulerName"] == "default-scheduler"
