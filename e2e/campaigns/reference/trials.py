"""Tries the reference applications on real nodes: what each does, and what its README promises of one fault.

A trial raises BrokenPromiseError for a promise that is not kept; figures that were measured before it stay.
"""

import csv
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from campaigns.nodes.real_pods import shell
from campaigns.reference.catalogue import FLEET, ROBOT, SENSOR
from campaigns.reference.running_app import STARTED_S, BrokenPromiseError, RunningApp

Figures = dict[str, float]
CUT_S: Final = 10.0
STOPPED_S: Final = 1.5
"""Half a second after the last command, and what a busy machine adds."""
HEALS_S: Final = 30.0
TCP_HEALS: Final = 1.0
"""After an outage TCP tries again when as much time has passed once more, at the latest."""
TRIPS: Final = 100
PICTURES: Final = 20
RECALL: Final = 0.9
TASKS: Final = 60
FIRST_TASKS: Final = 8
ON_ITS_WAY: Final = 5
"""Paths that the planner has made, one a second, before the fault."""
DRIVEN_S: Final = 90.0
NOTICED_S: Final = 20.0
LOST_S: Final = 11.0
"""A loss of less than 10 s restarts nothing."""
BACK_S: Final = 40.0


@dataclass(slots=True)
class Trial:
    """One application under one scheduler. `broken` is the promise that it did not keep, "" when it kept all."""

    app: str
    scheduler: str
    fault: str
    outage_s: float = CUT_S
    nodes: dict[str, str] = field(default_factory=dict)
    """By component, before the fault."""
    figures: Figures = field(default_factory=dict)
    broken: str = ""

    def demand(self, condition: object, promise: str) -> None:
        """Raises BrokenPromiseError with the promise unless the condition holds."""
        if not condition:
            raise BrokenPromiseError(promise)


def play(app: RunningApp, trial: Trial) -> None:
    """Applies the app, lets it work, makes the fault and waits for what the README promises; the outcome is in the trial."""
    try:
        app.apply()
        TRIALS[app.scenario.name](app, trial)
    except BrokenPromiseError as problem:
        trial.broken = str(problem)


def list_trips(app: RunningApp) -> list[tuple[float, tuple[int, int, int, float, float, float]]]:
    """Returns time, commands, answers, late ones and three percentiles in ms of each summary of teleop's operator."""
    pattern = r"(\d+) commands, (\d+) answered, (\d+) late .*p50 ([\d.]+) ms, p95 ([\d.]+) ms, p99 ([\d.]+) ms"
    summaries = []
    for at_s, line in app.list_lines("operator"):
        if match := re.search(pattern, line):
            sent, answered, late = map(int, match.groups()[:3])
            p50, p95, p99 = map(float, match.groups()[3:])
            summaries.append((at_s, (sent, answered, late, p50, p95, p99)))
    return summaries


def try_teleop(app: RunningApp, trial: Trial) -> None:
    def count_answers() -> int:
        summaries = list_trips(app)
        return summaries[-1][1][1] if summaries else 0

    app.wait_until(
        lambda: count_answers() >= TRIPS,
        what=f"{TRIPS} commands are answered",
        component="operator",
        within_s=STARTED_S,
    )
    trial.nodes = app.list_nodes()
    _, (sent, _, late, p50, p95, p99) = list_trips(app)[-1]
    trial.figures |= {"p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "late_share": late / sent}
    link = ROBOT, trial.nodes["operator"]
    cut_s = time.time()
    app.cp.switch.set_link(*link, down=True)
    try:
        stopped_s = app.wait_for("robot", "stopped", after_s=cut_s, within_s=CUT_S)
        time.sleep(max(cut_s + trial.outage_s - time.time(), 0))
    finally:
        app.cp.switch.set_link(*link, down=False)
    back_s, answer_count = time.time(), count_answers()
    trial.figures["stopped_after_s"] = stopped_s - cut_s
    app.wait_until(
        lambda: count_answers() > answer_count + TRIPS,
        what=f"{TRIPS} more commands are answered after the link is back",
        component="operator",
        within_s=HEALS_S + TCP_HEALS * trial.outage_s,
    )
    trial.figures["answers_again_after_s"] = (
        next(at_s for at_s, summary in list_trips(app) if summary[1] > answer_count) - back_s
    )
    trial.demand(trial.figures["stopped_after_s"] <= STOPPED_S, f"stopped within {STOPPED_S} s of the cut")
    trial.demand(app.count_restarts() == 0, "no container is started again")


def read_pictures(app: RunningApp) -> list[dict[str, str]]:
    """Returns the rows of the detector's own table, [] while it has none."""
    pod = app.list_pods().get("detector")
    if pod is None:
        return []
    name = pod["metadata"]["name"]
    text = shell(app.cp, app.namespace, name, "cat /results/detections.csv 2>/dev/null", check=False)
    return [row for row in csv.DictReader(text.splitlines()) if row.get("hits")] if text.startswith("stamp") else []


def try_detection(app: RunningApp, trial: Trial) -> None:
    def wait_for_pictures() -> list[dict[str, str]]:
        app.wait_until(
            lambda: len(read_pictures(app)) >= PICTURES,
            what=f"{PICTURES} pictures are worked on",
            component="detector",
            within_s=STARTED_S,
        )
        return read_pictures(app)

    rows = wait_for_pictures()
    trial.nodes = app.list_nodes()
    trial.figures |= {
        "recall": find_recall(rows),
        "detect_ms": sum(float(row["detect_ms"]) for row in rows) / len(rows),
    }
    killed_s = time.time()
    app.kill_pod("detector")
    rows = wait_for_pictures()
    trial.figures["recall_after"] = find_recall(rows)
    trial.figures["next_picture_after_s"] = float(rows[0]["stamp"]) - killed_s
    for name in ("recall", "recall_after"):
        trial.demand(trial.figures[name] >= RECALL, f"{name} is at least {RECALL}, not {trial.figures[name]:.3f}")
    trial.demand(trial.figures["next_picture_after_s"] > 0, "the next detector begins with a later picture")


def find_recall(rows: list[dict[str, str]]) -> float:
    return sum(int(row["hits"]) for row in rows) / sum(int(row["signs"]) for row in rows)


def count_work(app: RunningApp) -> Counter[int]:
    """Returns how often each task was done, by what the robots printed."""
    logs = "\n".join(app.read_log(robot) for robot in _FLEET_COMPONENTS)
    return Counter(int(task) for task in re.findall(r"did task (\d+)", logs))


_FLEET_COMPONENTS: Final = tuple(f"robot-{number}" for number, _ in enumerate(FLEET, 1))


def try_fleet(app: RunningApp, trial: Trial) -> None:
    app.wait_until(
        lambda: len(count_work(app)) >= FIRST_TASKS,
        what=f"{FIRST_TASKS} tasks are done",
        component="coordinator",
        within_s=STARTED_S,
    )
    trial.nodes = app.list_nodes()
    killed_s = time.time()
    app.kill_pod("coordinator")
    # What it had read from its volume is the first line of the new one.
    begun_s = app.wait_for("coordinator", f" of {TASKS} tasks are done", within_s=STARTED_S)
    trial.figures["coordinator_after_s"] = begun_s - killed_s
    first_line = next(line for _, line in app.list_lines("coordinator") if "tasks are done" in line)
    trial.figures["tasks_on_volume"] = float(re.findall(r"(\d+) of", first_line)[0])
    done_s = app.wait_for("coordinator", f"{TASKS} of {TASKS} tasks are done", within_s=STARTED_S)
    trial.figures["all_done_after_s"] = done_s - killed_s
    work = count_work(app)
    repeated = sorted(task for task, count in work.items() if count > 1)
    undone = sorted(set(range(1, TASKS + 1)) - set(work))
    trial.figures |= {"tasks": len(work), "done_twice": len(repeated)}
    trial.demand(trial.figures["tasks_on_volume"] > 0, "the next coordinator finds what was done on its volume")
    trial.demand(not repeated and not undone, f"each task is done once; twice {repeated}, not at all {undone}")


def try_navigation(app: RunningApp, trial: Trial) -> None:
    def list_paths() -> list[str]:
        return [line for _, line in app.list_lines("planner") if "a path of" in line]

    app.wait_until(
        lambda: len(list_paths()) >= ON_ITS_WAY, what="the robot is on its way", component="planner", within_s=STARTED_S
    )
    trial.nodes = app.list_nodes()
    trial.demand("reached" not in app.read_log("planner"), "the robot is still on its way when the fault comes")
    node, cut_s = app.cp.node(trial.nodes["robot"]), time.time()
    app.cp.switch.set_node(node.name, down=True)
    node.cut_off()
    time.sleep(trial.outage_s)
    node.reconnect()
    app.cp.switch.set_node(node.name, down=False)
    back_s = time.time()
    # The log is on the robot's node: it can be read only now.
    stopped_s = app.wait_for("robot", "stopped", after_s=cut_s, within_s=HEALS_S)
    trial.figures["stopped_after_s"] = stopped_s - cut_s
    within_s = HEALS_S + TCP_HEALS * trial.outage_s + DRIVEN_S
    reached_s = app.wait_for("planner", "reached the goal", within_s=within_s)
    trial.figures["reached_after_back_s"] = reached_s - back_s
    line = next(line for _, line in app.list_lines("planner") if "reached the goal" in line)
    trial.figures["way_m"] = float(re.findall(r"and ([\d.]+) m", line)[0])
    trial.demand(trial.figures["stopped_after_s"] <= STOPPED_S, f"stopped within {STOPPED_S} s of the outage")
    trial.demand("collided" not in app.read_log("robot"), "the robot does not collide")
    trial.demand(app.count_restarts() == 0, "no container is started again")


def try_usb_sensor(app: RunningApp, trial: Trial) -> None:
    def count_readings() -> int:
        summaries = re.findall(r"(\d+) readings, the last", app.read_log("listener"))
        return int(summaries[-1]) if summaries else 0

    app.wait_for("driver", "connected to /dev/sensor", within_s=STARTED_S)
    first_s = app.wait_for("listener", "readings, the last", within_s=STARTED_S)
    trial.figures["readings_after_s"] = first_s - app.applied_s
    trial.nodes = app.list_nodes()
    uids = {component: app.uid_of(component) for component in ("driver", "listener")}
    driver = app.list_pods()["driver"]["metadata"]["name"]
    trial.demand(shell(app.cp, app.namespace, driver, "id -u") == "65532\n", "the driver runs without privileges")
    back_s = _unplug(app)
    again_s = app.wait_for("listener", "readings are back after", within_s=BACK_S, after_s=back_s)
    trial.figures["readings_again_after_s"] = again_s - back_s
    # The pod may have found the sensor again by itself; it is replaced all the same, because the file may mean another one.
    app.wait_until(
        lambda: app.uid_of("driver") not in ("", uids["driver"]),
        what="the driver's pod is replaced",
        component="driver",
        within_s=BACK_S,
    )
    trial.figures["new_pod_has_it_after_s"] = (
        app.wait_for("driver", "connected to /dev/sensor", within_s=BACK_S, after_s=back_s) - back_s
    )
    count = count_readings()
    app.wait_until(lambda: count_readings() > count, what="readings go on", component="listener", within_s=BACK_S)
    trial.demand(app.uid_of("listener") == uids["listener"], "the listener's pod stays")
    trial.demand(app.count_restarts() == 0, "no container is started again")


def _unplug(app: RunningApp) -> float:
    """Takes the sensor away until its loss counts, and puts it back. Returns when that was: what is printed before concerns another gap."""
    devices = app.cp.node(ROBOT).devices
    unplugged_s = time.time()
    devices.unplug(SENSOR.id)
    try:
        app.wait_for("driver", "was unplugged after", within_s=NOTICED_S, after_s=unplugged_s)
        app.wait_for("driver", "no device at /dev/sensor", within_s=NOTICED_S, after_s=unplugged_s)
        app.wait_for("listener", "no readings for 2 s", within_s=NOTICED_S, after_s=unplugged_s)
        app.wait_until(
            lambda: app.read_reason("Allocated") == "DeviceLost",
            what="the condition Allocated has the reason DeviceLost",
            component="driver",
            within_s=NOTICED_S,
        )
        time.sleep(LOST_S)
    finally:
        back_s = time.time()
        devices.plug(SENSOR.id)
    return back_s


TRIALS: Final[Mapping[str, Callable[[RunningApp, Trial], None]]] = {
    "teleop": try_teleop,
    "navigation": try_navigation,
    "usb-sensor": try_usb_sensor,
    "fleet": try_fleet,
    "detection": try_detection,
}
