"""teleop-ros2 over real DDS: every command is answered, and a robot without commands stops and drives on with the next operator."""

import csv
import logging
from collections.abc import Callable

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

PARAMETERS = "--ros-args --params-file /ws/install/share/reference_teleop/config/teleop.yaml"
OPERATOR = f"ros2 run reference_teleop operator {PARAMETERS}"
ROBOT = f"ros2 run reference_teleop robot {PARAMETERS}"
STARTED_S = 30.0
TRIPS = 100
STOP_AFTER_S = 0.5
CONTROL_PERIOD_S = 0.05
SLACK_S = 0.1
"""What a busy machine may add to the robot's clock, where `slowness` is 1."""


def read_trips(programs: Programs) -> list[str]:
    """Returns the round trips of the operator's CSV in ms, "" for a command without an answer."""
    path = programs.root / "results" / "round_trips.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [row["rtt_ms"] for row in csv.DictReader(file)]


def list_speeds(programs: Programs) -> list[tuple[float, float]]:
    """Returns time and speed of each state that the robot has published."""
    return [(at_s, float(speed)) for at_s, speed in programs.seen("states")]


def start_pair(programs: Programs) -> None:
    programs.watch("states", "nav_msgs.msg.Odometry", "/robot_state", "m.twist.twist.linear.x")
    programs.start("robot", ROBOT)
    programs.start("operator", OPERATOR)


def test_every_command_is_answered_and_its_round_trip_is_written_down(run_app: Callable[[str], Programs]) -> None:
    programs = run_app("teleop-ros2")
    start_pair(programs)
    assert wait_until(lambda: len(read_trips(programs)) >= TRIPS, timeout_s=STARTED_S * slowness()), programs.log(
        "operator"
    )
    programs.stop("operator")
    trips = read_trips(programs)
    # Commands that were sent before both ends had discovered each other may be lost.
    assert trips[5:].count("") == 0
    assert all(float(trip) > 0 for trip in trips[5:])
    logger.info("%s", programs.log("operator").strip().splitlines()[-1])
    assert " commands, " in programs.log("operator")


def test_a_robot_whose_operator_is_killed_stops_and_drives_on_with_the_next_one(
    run_app: Callable[[str], Programs],
) -> None:
    programs = run_app("teleop-ros2")
    start_pair(programs)
    assert wait_until(lambda: any(speed == 0.3 for _, speed in list_speeds(programs)), timeout_s=STARTED_S * slowness())
    programs.kill("operator")
    assert wait_until(lambda: list_speeds(programs)[-1][1] == 0.0, timeout_s=5 * slowness())
    (driven_s, _), (stopped_s, _) = list_speeds(programs)[-2:]
    allowed_s = STOP_AFTER_S + CONTROL_PERIOD_S + SLACK_S * slowness()
    logger.info("stopped %.2f s after the last command, allowed are %.2f s", stopped_s - driven_s, allowed_s)
    assert STOP_AFTER_S - SLACK_S <= stopped_s - driven_s <= allowed_s
    programs.start("operator", OPERATOR)
    assert wait_until(lambda: list_speeds(programs)[-1][1] == 0.3, timeout_s=STARTED_S * slowness())
