"""`scripts/bench teleop` from rows made by hand."""

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


def test_a_scheduler_without_any_command_missed_all() -> None:
    found = outcome("x", {})
    assert found.missed_share == 1.0
    assert teleop.table([found])[1].split() == ["x", "1", "-", "-", "-", "100.0%", "(100.0%-100.0%)"]
