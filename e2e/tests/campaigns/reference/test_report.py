"""`scripts/bench reference`: outcomes of several short runs become one report, and its tables go between the marks of a page."""

import json
from pathlib import Path

import pytest

from campaigns.common.output import save
from campaigns.reference import reference
from campaigns.reference.catalogue import (
    CLOUD,
    EDGE,
    OFF_BOARD_NODES,
    ROBOT,
    SCENARIOS,
    SENSOR,
    list_delays,
    merge_nodes,
)
from campaigns.reference.placement import Placement
from campaigns.reference.profiles import infer
from campaigns.reference.report import (
    PLACEMENT_MARKS,
    PROFILE_MARKS,
    SHARE_MARKS,
    TRIAL_MARKS,
    Report,
    append_line,
    describe_figure,
    list_broken,
    read_report,
    tabulate_placements,
    tabulate_profiles,
    tabulate_shares,
    tabulate_trials,
    write_page,
)
from campaigns.reference.running_app import read_time
from campaigns.reference.trials.detection import find_recall
from campaigns.reference.trials.trial import Trial

OURS, THEIRS = "robotapp", "kube-scheduler"


def placement(
    app: str = "teleop-ros2", scheduler: str = OURS, repetition: int = 0, *, is_kept: bool = True
) -> Placement:
    nodes = {"operator": "edge-1", "robot": "amr-07"}
    return Placement(app, scheduler, repetition, nodes, {"a": True, "b": is_kept}, {}, ["LatencyFilter"])


def trial(app: str = "teleop-ros2", scheduler: str = OURS, broken: str = "", fault: str = "link cut 10 s") -> Trial:
    return Trial(app, scheduler, fault, nodes={"robot": "amr-07"}, figures={"p50_ms": 4.9}, broken=broken)


def test_a_later_run_replaces_the_same_outcome_and_keeps_the_others(tmp_path: Path) -> None:
    path, first, second = tmp_path / "report.json", Report(), trial(broken="stopped late")
    for outcome in (trial(), trial(scheduler=THEIRS), trial(fault="robot offline 60 s"), second):
        first.note_trial(outcome)
    first.note_placement(placement())
    save(path, first.to_json())
    report = read_report(path)
    assert report.trials == [trial(scheduler=THEIRS), trial(fault="robot offline 60 s"), second]
    assert report.has_trial("teleop-ros2", THEIRS, "link cut 10 s")
    assert not report.has_trial("teleop-ros1", THEIRS, "link cut 10 s")
    assert report.has_placement("teleop-ros2", OURS, 0)
    assert not report.has_placement("teleop-ros2", OURS, 1)
    assert [p.kept for p in report.placements] == [2]
    assert read_report(tmp_path / "none.json") == Report()


def test_what_ours_does_not_keep_is_a_problem_and_what_the_other_does_not_keep_is_none() -> None:
    report = Report(
        placements=[placement(is_kept=False), placement(scheduler=THEIRS, is_kept=False)],
        trials=[trial(broken="stopped late"), trial(scheduler=THEIRS, broken="x")],
    )
    assert list_broken(report) == ["teleop-ros2, placement 0: b", "teleop-ros2, link cut 10 s: stopped late"]


def test_placements_are_counted_over_their_repetitions() -> None:
    (row,) = tabulate_placements([placement(), placement(repetition=1, is_kept=False)])
    assert row[:5] == ["teleop-ros2", "LatencyFilter, LatencyScore, DeadlineScore", "LatencyFilter", OURS, "1/2"]
    assert row[5:] == ["operator on edge-1, robot on amr-07", "b"]


def test_a_trial_that_was_not_kept_has_one_line_of_why() -> None:
    row = tabulate_trials([trial(broken="it stops: not within 90 s; robot printed last: x\nNAME READY")])[0]
    assert row[-1] == "not kept: it stops: not within 90 s"


def test_trials_are_listed_by_application_fault_and_scheduler_beside_the_figures_of_the_thesis() -> None:
    trials = [trial(scheduler=THEIRS), trial(fault="robot offline 60 s"), trial(), trial(app="teleop-ros1")]
    rows = tabulate_trials(trials)
    assert [row[:3] for row in rows] == [
        ["teleop-ros1", "link cut 10 s", OURS],
        ["teleop-ros2", "link cut 10 s", OURS],
        ["teleop-ros2", "link cut 10 s", THEIRS],
        ["teleop-ros2", "robot offline 60 s", OURS],
    ]
    assert [row[6].split(",")[0] for row in rows] == ["-", "mean 0.66 ms", "mean 0.71 ms", "mean 0.66 ms"]


def test_each_trial_is_a_line_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    for outcome in (trial(), trial(broken="stopped late")):
        append_line(path, outcome)
    assert [json.loads(line)["broken"] for line in path.read_text().splitlines()] == ["", "stopped late"]


def test_shares_of_right_placements_stand_beside_each_other() -> None:
    placements = [placement(), placement(repetition=1), placement(scheduler=THEIRS, is_kept=False)]
    assert tabulate_shares(placements) == [["teleop-ros2", "2/2", "0/1", "b"]]


def test_the_thesis_has_profiles_of_ros_2_alone() -> None:
    profiles = {app: infer(app) for app in ("fleet-ros1", "fleet-ros2")}
    first, second = tabulate_profiles(profiles)
    assert first[1:3] == ["-", "-"]
    assert second[1:] == ["best_effort, none", "realtime, none", "system_default, none", "system_default, none"]


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("p50_ms", 4.94, "p50 4.9 ms"),
        ("late_share", 0.031, "late 3%"),
        ("stopped_after_s", 0.5449, "stopped after 0.545 s"),
        ("way_m", 11.8, "way 11.8 m"),
        ("tasks", 60.0, "tasks 60"),
    ],
)
def test_figures_are_shown_with_their_units(name: str, value: float, text: str) -> None:
    assert describe_figure(name, value) == text


def test_the_tables_of_a_page_are_replaced_and_the_rest_stays() -> None:
    marks = (PLACEMENT_MARKS, TRIAL_MARKS, PROFILE_MARKS)
    page = "head\n" + "\n".join(f"{begin}\nold\n{end}\nbetween" for begin, end in marks)
    report = Report(placements=[placement()], profiles={"fleet-ros2": infer("fleet-ros2")})
    written = write_page(report, page)
    assert written.startswith("head\n")
    assert written.count("between") == 3
    assert written.count("old") == 1, "there is no trial: that table stays"
    assert write_page(report, written) == written
    begin, end = SHARE_MARKS
    assert "| teleop-ros2 | 1/1 |" in write_page(report, f"{begin}\n{end}"), (
        "a page has the tables that it has marks of"
    )


def test_a_page_names_the_day_and_the_commands_of_its_trials() -> None:
    begin, end = TRIAL_MARKS
    outcome = trial()
    outcome.began_at = "2026-11-29T11:50:00+00:00"
    command = "scripts/bench reference --real --app teleop"
    page = write_page(Report([command, "scripts/bench reference"], trials=[outcome]), f"{begin}\n{end}")
    assert f"Made on 2026-11-29 by\n```\n{command}\n```\n" in page


def test_a_command_is_shown_without_its_files() -> None:
    shown = reference._command(["--app", "fleet", "--json", "out.json", "--lines", "runs.jsonl", "--real"])
    assert shown == "scripts/bench reference --app fleet --real"


def test_a_time_of_a_log_has_nanoseconds() -> None:
    assert read_time("2026-11-29T06:00:00.123456789Z") == pytest.approx(1795932000.1234567)
    assert read_time("2026-11-29T06:00:00Z") == 1795932000


def test_recall_is_over_all_pictures() -> None:
    assert find_recall([{"signs": "3", "hits": "3"}, {"signs": "3", "hits": "2"}]) == pytest.approx(5 / 6)


def test_every_scenario_has_links_between_its_real_nodes() -> None:
    for scenario in SCENARIOS.values():
        names = {node.name for node in scenario.nodes}
        assert {name for pair in list_delays(names) for name in pair} == names


def test_one_cluster_has_the_nodes_and_devices_of_all_scenarios() -> None:
    nodes = {node.name: node for node in merge_nodes(list(SCENARIOS.values()), OFF_BOARD_NODES)}
    assert {ROBOT, EDGE, CLOUD} < nodes.keys()
    assert len(nodes) == 6
    assert [*nodes[ROBOT].devices] == [SENSOR]
    detection = SCENARIOS["detection"]
    assert [node.name for node in merge_nodes([detection], OFF_BOARD_NODES)] == [ROBOT, EDGE, CLOUD]
    assert detection.list_hosts(nodes) == [ROBOT, CLOUD, EDGE]
    assert detection.list_hosts([ROBOT, EDGE]) == [ROBOT, EDGE]
