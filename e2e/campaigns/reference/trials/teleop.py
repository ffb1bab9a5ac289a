"""Teleoperation: round trips, a robot that stops by itself, and round trips that begin again."""

import re
import time
from typing import Final

from campaigns.reference.catalogue import Fault
from campaigns.reference.running_app import STARTED_S, RunningApp
from campaigns.reference.trials.outages import make_outage
from campaigns.reference.trials.trial import HEALS_S, STOPPED_S, Trial

TRIPS: Final = 100
_SUMMARY: Final = re.compile(
    r"(\d+) commands, (\d+) answered, (\d+) late .*p50 ([\d.]+) ms, p95 ([\d.]+) ms, p99 ([\d.]+) ms"
)
Summary = tuple[int, int, int, float, float, float]
"""Commands, answers, late ones and three percentiles in ms."""


def try_teleop(app: RunningApp, trial: Trial, fault: Fault) -> None:
    wait_for_trips(app, TRIPS, within_s=STARTED_S)
    trial.nodes = app.list_nodes()
    _, (sent, _, late, p50, p95, p99) = list_trips(app)[-1]
    trial.figures |= {"p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "late_share": late / sent}
    if fault is Fault.POD_KILLED:
        _replace_operator(app, trial)
    elif fault is Fault.MASTER_KILLED:
        killed_s = time.time()
        app.replace_master(("operator", "robot"))
        _wait_for_new_operator(app, trial, killed_s)
    else:
        _cut_off(app, trial, fault)
    trial.demand(app.count_restarts() == 0, "no container is started again")


def _cut_off(app: RunningApp, trial: Trial, fault: Fault) -> None:
    outage = make_outage(app, trial, fault, robot="robot", partner="operator")
    answer_count = count_answers(app, until_s=outage.ended_s)
    # The log may be on a node that was offline.
    stopped_s = app.wait_for("robot", "stopped", after_s=outage.began_s, within_s=HEALS_S)
    trial.figures["stopped_after_s"] = stopped_s - outage.began_s
    wait_for_trips(app, answer_count + TRIPS, within_s=trial.heals_within_s)
    answered_s = next(at_s for at_s, summary in list_trips(app) if summary[1] > answer_count)
    trial.figures["answers_again_after_s"] = answered_s - outage.ended_s
    trial.demand(trial.figures["stopped_after_s"] <= STOPPED_S, f"stopped within {STOPPED_S} s of the {fault}")


def _replace_operator(app: RunningApp, trial: Trial) -> None:
    killed_s = time.time()
    app.kill_pod("operator")
    stopped_s = app.wait_for("robot", "stopped", after_s=killed_s, within_s=HEALS_S)
    trial.figures["stopped_after_s"] = stopped_s - killed_s
    _wait_for_new_operator(app, trial, killed_s)


def _wait_for_new_operator(app: RunningApp, trial: Trial, killed_s: float) -> None:
    wait_for_trips(app, TRIPS, within_s=STARTED_S)
    answered_s = next(at_s for at_s, summary in list_trips(app) if summary[1])
    trial.figures["answers_again_after_s"] = answered_s - killed_s


def wait_for_trips(app: RunningApp, count: int, *, within_s: float) -> None:
    """Waits until the operator's newest pod has so many answers."""
    app.wait_until(
        lambda: count_answers(app) >= count,
        what=f"{count} commands are answered",
        component="operator",
        within_s=within_s,
    )


def count_answers(app: RunningApp, *, until_s: float = float("inf")) -> int:
    """Returns how many answers the operator's newest pod has counted up to a time."""
    return max((summary[1] for at_s, summary in list_trips(app) if at_s <= until_s), default=0)


def list_trips(app: RunningApp) -> list[tuple[float, Summary]]:
    """Returns each summary of the operator's newest pod with the time when it was printed."""
    return [
        (at_s, read_summary(match)) for at_s, line in app.list_lines("operator") if (match := _SUMMARY.search(line))
    ]


def read_summary(match: re.Match[str]) -> Summary:
    commands, answers, late_answers = map(int, match.groups()[:3])
    p50, p95, p99 = map(float, match.groups()[3:])
    return commands, answers, late_answers, p50, p95, p99
