"""navigation-ros1 with a real roscore and navigation-ros2 over real DDS: the robot reaches its goal around two walls, and stands still while its planner is away."""

import logging
import re
from collections.abc import Callable

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

PARAMETERS = "--ros-args --params-file /ws/install/share/reference_navigation/config/navigation.yaml"
PLANNER, ROBOT = (
    {
        "navigation-ros1": f"roslaunch --wait reference_navigation {node}.launch",
        "navigation-ros2": f"ros2 run reference_navigation {node} {PARAMETERS}",
    }
    for node in ("planner", "robot")
)
APPS = sorted(ROBOT)
PLOTS_NOTHING = {"MPLBACKEND": "Agg"}
STARTED_S = 60.0
DRIVEN_S = 90.0
ON_ITS_WAY_M = 2.0


def list_places(programs: Programs) -> list[float]:
    """Returns how far right the robot was in each of its reports."""
    return [float(x) for _, x in programs.seen("odom")]


@pytest.mark.parametrize("app", APPS)
def test_a_robot_stands_still_without_its_planner_and_reaches_its_goal_with_the_next_one(
    app: str,
    run_app: Callable[[str], Programs],
) -> None:
    programs = run_app(app)
    programs.watch("odom", "nav_msgs.msg.Odometry", "/odom", "m.pose.pose.position.x")
    programs.start("robot", ROBOT[app], PLOTS_NOTHING)
    programs.start("planner", PLANNER[app])
    on_its_way = wait_until(
        lambda: max(list_places(programs), default=0.0) > ON_ITS_WAY_M, timeout_s=STARTED_S * slowness()
    )
    assert on_its_way, programs.log("robot") + programs.log("planner")
    programs.kill("planner")
    assert wait_until(lambda: "stopped" in programs.log("robot"), timeout_s=STARTED_S)
    stopped_at, seen = list_places(programs)[-1], len(list_places(programs))
    assert wait_until(lambda: len(list_places(programs)) > seen + 10, timeout_s=STARTED_S)
    assert list_places(programs)[-1] == pytest.approx(stopped_at, abs=0.1)
    programs.start("planner", PLANNER[app])
    reached = wait_until(lambda: "reached the goal" in programs.log("planner"), timeout_s=DRIVEN_S * slowness())
    assert reached, programs.log("planner")
    logger.info("%s", re.findall(r"reached.*", programs.log("planner"))[-1])
    assert "collided" not in programs.log("robot")
