"""Trials of the reference applications: what is made of their logs, which fault is made, and what of it is a broken promise."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, cast

import pytest

from campaigns.reference.catalogue import EDGE, FLEET, ROBOT, SCENARIOS, Fault
from campaigns.reference.running_app import BrokenPromiseError, RunningApp
from campaigns.reference.trials import detection, teleop
from campaigns.reference.trials.play import play
from campaigns.reference.trials.trial import STOPPED_S, Trial
from robotapp_testbed.real import RealNodes

Nothing = Callable[[], None]
NODES = {
    "teleop": {"operator": EDGE, "robot": ROBOT},
    "navigation": {"planner": "cloud-1", "robot": ROBOT},
    "fleet": {"coordinator": EDGE, **{f"robot-{number}": name for number, name in enumerate(FLEET, 1)}},
    "detection": {"camera": ROBOT, "detector": EDGE},
}


class ScriptedApp(RunningApp):
    """An application whose logs a test writes. `during` and `after` are called within a fault and when it is over."""

    def __init__(self, scenario: str, *, during: Nothing = lambda: None, after: Nothing = lambda: None) -> None:
        super().__init__(cast(RealNodes, None), "here", SCENARIOS[scenario], f"{scenario}-ros2", scheduler="x")
        self.lines: dict[str, list[tuple[float, str]]] = {}
        self.faults: list[tuple[str, ...]] = []
        self.uids = {component: f"{component}-1" for component in NODES[scenario]}
        self.during, self.after = during, after

    def say(self, component: str, *lines: str, after_s: float = 0.0) -> None:
        self.lines.setdefault(component, []).extend((time.time() + after_s, line) for line in lines)

    def apply(self) -> None:
        self.applied_s = time.time()

    def list_nodes(self) -> dict[str, str]:
        return dict(NODES[self.scenario.name])

    def list_pods(self) -> dict[str, Any]:
        return {name: {"metadata": {"uid": uid, "name": name}} for name, uid in self.uids.items()}

    def count_restarts(self) -> int:
        return 0

    def list_lines(self, component: str, *, after_s: float = 0.0) -> list[tuple[float, str]]:
        return [(at_s, line) for at_s, line in self.lines.get(component, []) if at_s > after_s]

    def wait_until(self, condition: Callable[[], object], *, what: str, component: str, within_s: float) -> None:
        if not condition():
            raise BrokenPromiseError(f"{what}: not within {within_s} s; {component}")

    def kill_pod(self, component: str) -> None:
        self.faults.append(("killed", component))
        self.uids[component] += "0"
        self.lines[component] = []
        self.after()

    def replace_master(self, components: Sequence[str]) -> None:
        self.faults.append(("killed", "master"))
        for component in components:
            self.lines[component] = []
        self.after()

    @contextmanager
    def cut_link(self, name: str, other_name: str) -> Iterator[None]:
        yield from self._break("cut", name, other_name)

    @contextmanager
    def take_offline(self, name: str) -> Iterator[None]:
        yield from self._break("offline", name)

    def _break(self, *fault: str) -> Iterator[None]:
        self.faults.append(fault)
        self.during()
        yield
        self.after()


def summarise(commands: int, answers: int, late: int = 1) -> str:
    return f"{commands} commands, {answers} answered, {late} late (5%); p50 5.0 ms, p95 9.5 ms, p99 20.0 ms"


def run(app: ScriptedApp, fault: Fault) -> Trial:
    trial = Trial(app.name, "robotapp", "fault", outage_s=0.01)
    play(app, trial, fault)
    return trial


@pytest.mark.parametrize(
    ("fault", "made"), [(Fault.LINK_CUT, ("cut", ROBOT, EDGE)), (Fault.ROBOT_OFFLINE, ("offline", ROBOT))]
)
def test_teleop_stops_in_an_outage_and_answers_again(fault: Fault, made: tuple[str, ...]) -> None:
    app = ScriptedApp("teleop")
    app.say("operator", summarise(160, 150))
    app.during = lambda: app.say("robot", "no commands any more: stopped", after_s=0.005)
    app.after = lambda: app.say("operator", summarise(400, 150), summarise(500, 251), after_s=0.02)
    trial = run(app, fault)
    assert not trial.broken
    assert app.faults == [made]
    assert trial.nodes == NODES["teleop"]
    assert trial.figures["late_share"] == 1 / 160
    assert 0 < trial.figures["answers_again_after_s"] < 1


def test_a_robot_that_stops_late_breaks_its_promise_and_keeps_its_figures() -> None:
    app = ScriptedApp("teleop")
    app.say("operator", summarise(160, 150))
    app.during = lambda: app.say("robot", "stopped", after_s=STOPPED_S + 0.1)
    app.after = lambda: app.say("operator", summarise(500, 300), after_s=0.02)
    trial = run(app, Fault.LINK_CUT)
    assert trial.broken == f"stopped within {STOPPED_S} s of the link-cut"
    assert trial.figures["stopped_after_s"] > STOPPED_S


@pytest.mark.parametrize(("fault", "killed"), [(Fault.POD_KILLED, "operator"), (Fault.MASTER_KILLED, "master")])
def test_a_new_operator_counts_anew(fault: Fault, killed: str) -> None:
    app = ScriptedApp("teleop")
    app.say("operator", summarise(160, 150))

    def begin_anew() -> None:
        app.say("robot", "stopped", after_s=0.01)
        app.say("operator", summarise(0, 0), summarise(110, 100), after_s=0.02)

    app.after = begin_anew
    trial = run(app, fault)
    assert (trial.broken, app.faults) == ("", [("killed", killed)])
    assert trial.figures["answers_again_after_s"] > 0


def test_answers_up_to_a_moment_are_counted() -> None:
    app = ScriptedApp("teleop")
    app.lines["operator"] = [(1.0, summarise(20, 10)), (6.0, summarise(120, 90)), (11.0, summarise(220, 180))]
    assert [teleop.count_answers(app, until_s=until_s) for until_s in (0.5, 6.0, 20.0)] == [0, 90, 180]


def test_others_of_the_fleet_go_on_while_a_robot_is_offline() -> None:
    app = ScriptedApp("fleet")
    app.say("robot-1", *(f"robot_1 did task {task}" for task in range(1, 10)))
    app.say("coordinator", "9 of 60 tasks are done")

    def go_on() -> None:
        app.say("robot-2", *(f"robot_2 did task {task}" for task in range(10, 60)))
        app.say("coordinator", "robot_3 is silent, task 60 waits for it", "59 of 60 tasks are done", after_s=0.0001)

    def come_back() -> None:
        app.say("robot-3", "robot_3 did task 60")
        app.say("coordinator", "robot_3 is back", "60 of 60 tasks are done", after_s=1.0)

    app.during, app.after = go_on, come_back
    trial = run(app, Fault.ROBOT_OFFLINE)
    assert not trial.broken
    assert app.faults == [("offline", FLEET[-1])]
    assert trial.figures["tasks_meanwhile"] == 50
    assert (trial.figures["tasks"], trial.figures["done_twice"]) == (60, 0)


def test_a_robot_that_is_replaced_does_its_task_and_the_coordinator_counts_all() -> None:
    app = ScriptedApp("fleet")
    app.say("robot-1", *(f"robot_1 did task {task}" for task in range(1, 10)))
    app.say("coordinator", "9 of 60 tasks are done")

    def begin_anew() -> None:
        app.say("robot-3", "robot_3 did task 60", after_s=0.5)
        app.say("coordinator", "60 of 60 tasks are done", after_s=1.0)

    app.after = begin_anew
    trial = run(app, Fault.ROBOT_KILLED)
    assert (trial.broken, app.faults) == ("", [("killed", "robot-3")])
    assert 0 < trial.figures["works_again_after_s"] < trial.figures["all_done_after_s"]


def test_a_task_that_is_done_twice_is_named() -> None:
    app = ScriptedApp("fleet")
    app.say("robot-1", *(f"robot_1 did task {task}" for task in range(1, 61)), "robot_1 did task 7")

    def read_volume() -> None:
        app.say("coordinator", "60 of 60 tasks are done", after_s=0.01)

    app.after = read_volume
    trial = run(app, Fault.POD_KILLED)
    assert trial.broken == "each task is done once; twice [7], not at all []"
    assert trial.figures["tasks_on_volume"] == 60


def write_pictures(monkeypatch: pytest.MonkeyPatch, app: ScriptedApp, batches: list[list[float]], hits: int) -> None:
    """The detector's table has the next batch of stamps at each look, and the last one for ever."""
    del app
    looks = iter(batches)
    shown = [batches[0]]

    def read(*_: object, **__: object) -> str:
        shown[0] = next(looks, shown[0])
        rows = [f"{stamp},50.0,3,3,{hits}" for stamp in shown[0]]
        return "\n".join(["stamp,detect_ms,signs,detected,hits", *rows])

    monkeypatch.setattr(detection, "shell", read)


def test_pictures_from_before_the_camera_was_back_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    app = ScriptedApp("detection")
    begun_s = time.time()
    early = [begun_s - 100 + number for number in range(20)]
    late = [begun_s + 5 + number for number in range(20)]
    write_pictures(monkeypatch, app, [early, early, [*early, *late]], hits=3)
    trial = run(app, Fault.ROBOT_OFFLINE)
    assert not trial.broken
    assert app.faults == [("offline", ROBOT)]
    assert 4 < trial.figures["next_picture_after_s"] < 6


def test_a_detector_that_misses_signs_breaks_its_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    app = ScriptedApp("detection")
    write_pictures(monkeypatch, app, [[time.time() + 10 + number for number in range(20)]], hits=2)
    assert run(app, Fault.POD_KILLED).broken == "recall is at least 0.9, not 0.667"


@pytest.mark.parametrize("fault", [Fault.POD_KILLED, Fault.MASTER_KILLED])
def test_a_robot_reaches_its_goal_after_its_planner_or_its_master_was_replaced(fault: Fault) -> None:
    app = ScriptedApp("navigation")
    app.say("planner", *["a path of 12 points in 8 ms"] * 5)

    def begin_anew() -> None:
        app.say("robot", "no commands any more: stopped", after_s=2.0)
        app.say("planner", "reached the goal after 20.1 s and 9.5 m", after_s=20.0)

    app.after = begin_anew
    trial = run(app, fault)
    assert not trial.broken
    assert trial.figures["way_m"] == 9.5
    assert 19 < trial.figures["reached_after_back_s"] < 21


def test_a_first_broken_promise_is_noted_and_the_trial_goes_on() -> None:
    trial = Trial("a", "robotapp", "x")
    for text in ("first", "second"):
        with trial.noting():
            raise BrokenPromiseError(text)
    assert trial.broken == "first"


def test_nothing_is_made_of_a_fault_without_a_promise() -> None:
    with pytest.raises(ValueError, match="no outage of a robot"):
        run_unplugged()


def run_unplugged() -> Trial:
    app = ScriptedApp("teleop")
    app.say("operator", summarise(160, 150))
    return run(app, Fault.SENSOR_UNPLUGGED)
