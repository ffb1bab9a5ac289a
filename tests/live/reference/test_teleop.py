"""teleop-ros1 with a real roscore and teleop-ros2 over real DDS: every command is answered, and a robot without commands stops and drives on with the next operator."""

import csv
import logging
from collections.abc import Callable
from itertools import dropwhile

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

PARAMETERS = "--ros-args --params-file /ws/install/share/reference_teleop/config/teleop.yaml"
OPERATOR, ROBOT = (
    {
        "teleop-ros1": f"roslaunch --wait reference_teleop {node}.launch",
        "teleop-ros2": f"ros2 run reference_teleop {node} {PARAMETERS}",
    }
    for node in ("operator", "robot")
)
APPS = sorted(ROBOT)
STARTED_S = 30.0
TRIPS = 100
STOP_AFTER_S = 0.5
CONTROL_PERIOD_S = 0.05
SLACK_S = 0.1
"""What a busy machine may add to the robot's clock, where `slowness` is 1."""


def read_trips(programs: Programs) -> list[str]:
    """Returns the round trips of the operator's CSV in ms in the order of commands, "" for one without an answer.

    Those before the first answer are left out: both ends had not discovered each other yet.
    """
    path = programs.root / "results" / "round_trips.csv"
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["rtt_ms"] is not None]
    trips = [row["rtt_ms"] for row in sorted(rows, key=lambda row: float(row["sent_s"]))]
    return list(dropwhile(lambda trip: not trip, trips))


def list_speeds(programs: Programs) -> list[tuple[float, float]]:
    """Returns time and speed of each state that the robot has published."""
    return [(at_s, float(speed)) for at_s, speed in programs.seen("states")]


def start_pair(app: str, programs: Programs) -> None:
    programs.watch("states", "nav_msgs.msg.Odometry", "/robot_state", "m.twist.twist.linear.x")
    programs.start("robot", ROBOT[app])
    programs.start("operator", OPERATOR[app])


@pytest.mark.parametrize("app", APPS)
def test_every_command_is_answered_and_its_round_trip_is_written_down(
    app: str, run_app: Callable[[str], Programs]
) -> None:
    programs = run_app(app)
    start_pair(app, programs)
    assert wait_until(lambda: len(read_trips(programs)) >= TRIPS, timeout_s=STARTED_S * slowness()), programs.log(
        "operator"
    )
    programs.stop("operator")
    trips = read_trips(programs)
    assert trips.count("") == 0
    assert all(float(trip) > 0 for trip in trips)
    summaries = [line for line in programs.log("operator").splitlines() if " commands, " in line]
    assert summaries
    logger.info("%s", summaries[-1])


@pytest.mark.parametrize("app", APPS)
def test_a_robot_whose_operator_is_killed_stops_and_drives_on_with_the_next_one(
    app: str,
    run_app: Callable[[str], Programs],
) -> None:
    programs = run_app(app)
    start_pair(app, programs)
    assert wait_until(lambda: any(speed == 0.3 for _, speed in list_speeds(programs)), timeout_s=STARTED_S * slowness())
    programs.kill("operator")
    assert wait_until(lambda: list_speeds(programs)[-1][1] == 0.0, timeout_s=5 * slowness())
    (driven_s, _), (stopped_s, _) = list_speeds(programs)[-2:]
    allowed_s = STOP_AFTER_S + CONTROL_PERIOD_S + SLACK_S * slowness()
    logger.info("stopped %.2f s after the last command, allowed are %.2f s", stopped_s - driven_s, allowed_s)
    assert STOP_AFTER_S - SLACK_S <= stopped_s - driven_s <= allowed_s
    programs.start("operator", OPERATOR[app])
    assert wait_until(lambda: list_speeds(programs)[-1][1] == 0.3, timeout_s=STARTED_S * slowness())
