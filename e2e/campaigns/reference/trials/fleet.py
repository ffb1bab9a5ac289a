"""The fleet: every task is done exactly once, whoever is away meanwhile."""

import re
import time
from collections import Counter
from typing import Final

from campaigns.reference.catalogue import FLEET, Fault
from campaigns.reference.running_app import STARTED_S, RunningApp
from campaigns.reference.trials.outages import make_outage
from campaigns.reference.trials.trial import HEALS_S, Trial

TASKS: Final = 60
FIRST_TASKS: Final = 8
ROBOTS: Final = tuple(f"robot-{number}" for number, _ in enumerate(FLEET, 1))
_DONE: Final = re.compile(rf"(\d+) of {TASKS} tasks are done")


def try_fleet(app: RunningApp, trial: Trial, fault: Fault) -> None:
    app.wait_until(
        lambda: len(count_work(app)) >= FIRST_TASKS,
        what=f"{FIRST_TASKS} tasks are done",
        component="coordinator",
        within_s=STARTED_S,
    )
    trial.nodes = app.list_nodes()
    if fault is Fault.POD_KILLED:
        ended_s = _replace_coordinator(app, trial)
        within_s = STARTED_S
    elif fault is Fault.ROBOT_KILLED:
        _replace_robot(app, trial)
        return
    else:
        ended_s = _lose_robot(app, trial, fault)
        within_s = STARTED_S + trial.heals_within_s
    done_s = app.wait_for("coordinator", f"{TASKS} of {TASKS} tasks are done", within_s=within_s)
    trial.figures["all_done_after_s"] = done_s - ended_s
    work = count_work(app)
    repeated = sorted(task for task, count in work.items() if count > 1)
    undone = sorted(set(range(1, TASKS + 1)) - set(work))
    trial.figures |= {"tasks": len(work), "done_twice": len(repeated)}
    trial.demand(not repeated and not undone, f"each task is done once; twice {repeated}, not at all {undone}")


def _replace_coordinator(app: RunningApp, trial: Trial) -> float:
    """Kills the coordinator's pod. Returns when that was."""
    killed_s = time.time()
    app.kill_pod("coordinator")
    # What it had read from its volume is the first line of the new one.
    begun_s = app.wait_for("coordinator", f" of {TASKS} tasks are done", within_s=STARTED_S)
    trial.figures["coordinator_after_s"] = begun_s - killed_s
    trial.figures["tasks_on_volume"] = list_done(app)[0]
    trial.demand(trial.figures["tasks_on_volume"] > 0, "the next coordinator finds what was done on its volume")
    return killed_s


def _replace_robot(app: RunningApp, trial: Trial) -> None:
    """Kills the pod of the last robot, whose task waits for the next one: by the coordinator's book each task is done once."""
    killed_s = time.time()
    app.kill_pod(ROBOTS[-1])
    worked_s = app.wait_for(ROBOTS[-1], "did task", within_s=STARTED_S)
    trial.figures["works_again_after_s"] = worked_s - killed_s
    done_s = app.wait_for("coordinator", f"{TASKS} of {TASKS} tasks are done", within_s=STARTED_S)
    trial.figures["all_done_after_s"] = done_s - killed_s


def _lose_robot(app: RunningApp, trial: Trial, fault: Fault) -> float:
    """Takes the last robot away while the others go on. Returns when it was back."""

    def wait_for_others(began_s: float) -> None:
        app.wait_for("coordinator", "is silent", within_s=HEALS_S, after_s=began_s)

    done_before = max(list_done(app))
    outage = make_outage(app, trial, fault, robot=ROBOTS[-1], partner="coordinator", meanwhile=wait_for_others)
    trial.figures["tasks_meanwhile"] = max(list_done(app, until_s=outage.ended_s)) - done_before
    app.wait_for("coordinator", "is back", within_s=trial.heals_within_s, after_s=outage.began_s)
    trial.demand(trial.figures["tasks_meanwhile"] > FIRST_TASKS, "the others go on while a robot is away")
    return outage.ended_s


def list_done(app: RunningApp, *, until_s: float = float("inf")) -> list[int]:
    """Returns how many tasks were done, by each line of the coordinator's newest pod up to a time."""
    lines = [line for at_s, line in app.list_lines("coordinator") if at_s <= until_s]
    return [int(match[1]) for line in lines if (match := _DONE.search(line))] or [0]


def count_work(app: RunningApp) -> Counter[int]:
    """Returns how often each task was done, by what the robots printed."""
    logs = "\n".join(app.read_log(robot) for robot in ROBOTS)
    return Counter(int(task) for task in re.findall(r"did task (\d+)", logs))
