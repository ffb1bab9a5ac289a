"""fleet-ros1 with a real roscore and fleet-ros2 over real DDS: every task is done exactly once, also when the coordinator is killed and a robot is away."""

import re
from collections import Counter
from collections.abc import Callable

import pytest
from tests.live.reference.programs import Programs
from tests.support.work_unit import slowness

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

PARAMETERS = "--params-file /ws/install/share/reference_fleet/config/fleet.yaml"
COORDINATOR = {
    "fleet-ros1": "roslaunch --wait reference_fleet coordinator.launch",
    "fleet-ros2": f"ros2 run reference_fleet coordinator --ros-args {PARAMETERS}",
}
ROBOT = {
    "fleet-ros1": "roslaunch --wait reference_fleet robot.launch robot:={}",
    "fleet-ros2": f"ros2 run reference_fleet robot --ros-args -r __node:={{}} {PARAMETERS}",
}
APPS = sorted(ROBOT)
ROBOTS = ("robot_1", "robot_2", "robot_3")
TASKS = 60
FIRST = 8
"""Tasks that are done before the first fault."""
DONE_S = 90.0


def list_work(programs: Programs) -> Counter[int]:
    """Returns how often each task was done, by what the robots printed."""
    lines = "".join(programs.log(robot) for robot in ROBOTS)
    return Counter(int(task) for task in re.findall(r"did task (\d+)", lines))


def start_fleet(app: str, programs: Programs) -> None:
    programs.start("coordinator", COORDINATOR[app])
    for robot in ROBOTS:
        programs.start(robot, ROBOT[app].format(robot))


def is_done(programs: Programs) -> bool:
    return f"{TASKS} of {TASKS} tasks are done" in programs.log("coordinator")


@pytest.mark.parametrize("app", APPS)
def test_a_new_coordinator_goes_on_where_the_killed_one_was_and_no_task_is_done_twice(
    app: str,
    run_app: Callable[[str], Programs],
) -> None:
    programs = run_app(app)
    start_fleet(app, programs)
    assert wait_until(lambda: len(list_work(programs)) >= FIRST, timeout_s=DONE_S * slowness())
    programs.kill("coordinator")
    programs.start("coordinator", COORDINATOR[app])
    assert wait_until(lambda: is_done(programs), timeout_s=DONE_S * slowness()), programs.log("coordinator")
    assert list_work(programs) == dict.fromkeys(range(1, TASKS + 1), 1)
    assert {robot for robot in ROBOTS if "did task" in programs.log(robot)} == set(ROBOTS)


@pytest.mark.parametrize("app", APPS)
def test_the_others_go_on_while_a_robot_is_away_and_its_task_waits_for_it(
    app: str, run_app: Callable[[str], Programs]
) -> None:
    programs = run_app(app)
    start_fleet(app, programs)
    assert wait_until(lambda: "did task" in programs.log("robot_2"), timeout_s=DONE_S * slowness())
    programs.pause("robot_2")
    assert wait_until(lambda: "robot_2 is silent" in programs.log("coordinator"), timeout_s=DONE_S * slowness())
    assert wait_until(lambda: len(list_work(programs)) >= TASKS - 1, timeout_s=DONE_S * slowness())
    programs.resume("robot_2")
    assert wait_until(lambda: is_done(programs), timeout_s=DONE_S * slowness()), programs.log("coordinator")
    assert "robot_2 is back" in programs.log("coordinator")
    assert list_work(programs) == dict.fromkeys(range(1, TASKS + 1), 1)
