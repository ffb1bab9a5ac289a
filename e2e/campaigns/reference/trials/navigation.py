"""Navigation: a robot that stops when it is left alone, and reaches its goal afterwards without a collision."""

import re
import time
from typing import Final

from campaigns.reference.catalogue import Fault
from campaigns.reference.running_app import STARTED_S, RunningApp
from campaigns.reference.trials.outages import make_outage
from campaigns.reference.trials.trial import HEALS_S, STOPPED_S, Trial

ON_ITS_WAY: Final = 5
"""Paths that the planner has made, one a second, before the fault."""
DRIVEN_S: Final = 90.0


def try_navigation(app: RunningApp, trial: Trial, fault: Fault) -> None:
    def count_paths() -> int:
        return sum("a path of" in line for _, line in app.list_lines("planner"))

    app.wait_until(
        lambda: count_paths() >= ON_ITS_WAY, what="the robot is on its way", component="planner", within_s=STARTED_S
    )
    trial.nodes = app.list_nodes()
    trial.demand("reached" not in app.read_log("planner"), "the robot is still on its way when the fault comes")
    if fault is Fault.MASTER_KILLED:
        _begin_again(app, trial)
        return
    if fault is Fault.POD_KILLED:
        began_s = ended_s = time.time()
        app.kill_pod("planner")
        again_within_s = STARTED_S
    else:
        outage = make_outage(app, trial, fault, robot="robot", partner="planner")
        began_s, ended_s, again_within_s = outage.began_s, outage.ended_s, trial.heals_within_s
    # The log may be on a node that was offline: it can be read only now.
    stopped_s = app.wait_for("robot", "stopped", after_s=began_s, within_s=HEALS_S)
    trial.figures["stopped_after_s"] = stopped_s - began_s
    if fault is not Fault.POD_KILLED:
        with trial.noting():
            trial.demand(trial.figures["stopped_after_s"] <= STOPPED_S, f"stopped within {STOPPED_S} s of the {fault}")
    _reach_goal(app, trial, ended_s, within_s=again_within_s + DRIVEN_S)


def _begin_again(app: RunningApp, trial: Trial) -> None:
    """Replaces the master: the robot begins at its start again."""
    killed_s = time.time()
    app.replace_master(("planner", "robot"))
    _reach_goal(app, trial, killed_s, within_s=STARTED_S + DRIVEN_S)


def _reach_goal(app: RunningApp, trial: Trial, ended_s: float, *, within_s: float) -> None:
    reached_s = app.wait_for("planner", "reached the goal", within_s=within_s)
    trial.figures["reached_after_back_s"] = reached_s - ended_s
    line = next(line for _, line in app.list_lines("planner") if "reached the goal" in line)
    trial.figures["way_m"] = float(re.findall(r"and ([\d.]+) m", line)[0])
    trial.demand("collided" not in app.read_log("robot"), "the robot does not collide")
    trial.demand(app.count_restarts() == 0, "no container is started again")
