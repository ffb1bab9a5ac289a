"""info: one app, its instances from their RobotAppInstance objects, its edges, what happened."""

import re

import pytest
from tests.unit.cli.running import INSTANCES, ROBOTAPPS, STATUS, UID, Stage, instance, robotapp

EDGE = {
    "topic": "/cmd_vel",
    "from": "panel",
    "to": "driver",
    "budget": "30ms",
    "p95": "18ms",
    "measured": True,
    "met": True,
    "nodes": ["edge-1", "amr-07"],
}
SEEN = {
    "domain": 7,
    "phase": "Running",
    "summary": {"ready": "2/2", "budget": "18/30ms", "devices": "1/1", "nodes": "amr-07"},
    "components": [
        {"name": "driver", "node": "amr-07", "ready": True},
        {"name": "panel", "ready": False, "message": "ImagePullBackOff"},
    ],
    "edges": [EDGE],
}


class TestInfo:
    def test_shows_conditions_components_and_edges_with_bars(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        stage.add(INSTANCES, instance(**SEEN), instance("amr-09", uid="another app of that name"))
        text = stage.text("info", "teleop", PYTHONIOENCODING="utf-8")
        assert "robot amr-07, domain 7, Running" in text
        assert "amr-09" not in text
        assert "fleet/teleop  Running  ready 2/2" in text
        assert "AllComponentsReady" in text
        assert "NotStalled" not in text, "what is well and says False is left out"
        assert "ImagePullBackOff" in text
        (edge,) = [line for line in text.splitlines() if "/cmd_vel" in line]
        assert "18/30 ms" in edge
        assert "measured" in edge
        assert edge.count("█") + edge.count("#") == 7

    def test_helpers_are_listed_with_node_and_image(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        server = {
            "name": "discovery-0",
            "image": "ros:humble-ros-base",
            "node": "edge-1",
            "message": "ImagePullBackOff: x",
        }
        stage.add(INSTANCES, instance(**SEEN, helpers=[server]))
        (line,) = [line for line in stage.text("info", "teleop").splitlines() if "discovery-0" in line]
        assert all(text in line for text in ("edge-1", "ros:humble-ros-base", "ImagePullBackOff"))

    def test_an_edge_out_of_reach_says_so_and_fills_the_bar(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        lost = {key: value for key, value in EDGE.items() if key != "p95"} | {"met": False}
        free = {key: value for key, value in lost.items() if key not in ("budget", "met")} | {"topic": "/log"}
        stage.add(INSTANCES, instance(**SEEN | {"edges": [lost, free]}))
        lines = stage.text("info", "teleop", PYTHONIOENCODING="utf-8").splitlines()
        (edge,) = [line for line in lines if "/cmd_vel" in line]
        assert "unreachable/30 ms" in edge
        assert "█" * 12 + "!" in edge
        assert "unreachable, no budget" in next(line for line in lines if "/log" in line)

    def test_brackets_in_a_message_are_text_and_control_characters_are_not_obeyed(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        message = "slam: open [/dev/video0] of [amr-07] failed \x1b]0;mine\x07"
        stage.add(
            INSTANCES, instance(**SEEN | {"summary": {**SEEN["summary"], "message": message}, "phase": "Degraded"})
        )
        assert r"slam: open [/dev/video0] of [amr-07] failed \x1b]0;mine\x07" in stage.text("info", "teleop")

    def test_an_instance_without_a_robot_is_shown(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        stage.add(INSTANCES, instance("", **SEEN))
        assert "\ninstance, domain 7, Running\n" in stage.text("info", "teleop")

    def test_kinds_of_edges_are_shown_where_they_are_no_topics_and_omitted_ones_are_counted(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        edges = [{**EDGE, "kind": "Topic"}, {**EDGE, "kind": "Action", "topic": "/dock"}]
        stage.add(INSTANCES, instance(**{**SEEN, "edges": edges}, edgesOmitted=192))
        text = stage.text("info", "teleop")
        assert "/dock (Action)" in text
        assert "(Topic)" not in text
        assert "and 192 more edges" in text

    def test_moves_are_shown_with_their_age_and_the_claims_to_who_asks_for_everything(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        long_ago = ["2026-01-01T00:00:00Z", "2026-01-02T00:00:00Z"]
        moves = [{"component": "panel", "times": long_ago}, {"component": "driver", "times": long_ago[:1]}]
        stage.add(INSTANCES, instance(**SEEN, moves=moves, claims=["dds.default.c.7"]))
        text = stage.text("info", "teleop")
        assert re.search(r"^  panel was moved \S+ ago, 2 moves recorded$", text, re.MULTILINE)
        assert re.search(r"^  driver was moved \S+ ago$", text, re.MULTILINE)
        assert "dds.default.c.7" not in text
        assert "  claims dds.default.c.7\n" in stage.text("info", "teleop", "-o", "wide")

    def test_structured_output_has_the_instances_beside_the_app(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        stage.add(INSTANCES, instance(**SEEN), instance("amr-08"))
        found = stage.data("info", "teleop")
        assert found["app"]["status"]["instanceCounts"] == {"desired": 1, "ready": 1}
        assert [each["spec"]["robot"] for each in found["instances"]] == ["amr-08", "amr-07"], (
            "what is not well is first"
        )
        (only,) = stage.data("info", "teleop", "--robot", "amr-07")["instances"]
        assert only["status"]["domain"] == 7

    def test_instances_that_are_not_written_yet_are_counted(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status={**STATUS, "instanceCounts": {"desired": 3, "ready": 0}}))
        stage.add(INSTANCES, instance(**SEEN))
        text = stage.text("info", "teleop")
        assert "instances 0/3 ready" in text
        assert "2 of the app's instances have no RobotAppInstance yet" in text

    def test_an_unknown_robot_is_not_found(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        stage.add(INSTANCES, *(instance(f"bot-{number:02}") for number in range(12)))
        result = stage.run("info", "teleop", "--robot", "amr-07")
        assert result.exit_code == 4
        assert "teleop has no instance on robot amr-07; it has: bot-00, bot-01" in result.stderr
        assert result.stderr.endswith("bot-09 and 2 more\n")

    def test_says_when_the_operator_is_behind(self, stage: Stage) -> None:
        app = robotapp(status=STATUS)
        app["metadata"]["generation"] = 2
        stage.add(ROBOTAPPS, app)
        assert "has not seen the latest change" in stage.text("info", "teleop")

    def test_shows_the_latest_events(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        for number in range(12):
            event = {
                "metadata": {"name": f"e{number}", "namespace": "fleet"},
                "regarding": {"uid": UID},
                "reason": f"Reason{number}",
                "note": "n",
            }
            stage.add(
                "events.k8s.io/events",
                {**event, "eventTime": f"2026-01-01T00:00:{number:02}.000000Z", "type": "Normal"},
            )
        text = stage.text("info", "teleop")
        assert "Reason11" in text
        assert "Reason3 " not in text

    def test_a_new_app_without_status_is_shown(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp())
        assert "fleet/teleop  Pending" in stage.text("info", "teleop")


class TestInfoOfASweep:
    """Instances that have ended are not ready and in no trouble."""

    def test_counts_of_an_ended_sweep_agree_with_each_other(self, stage: Stage) -> None:
        summary = {**STATUS["summary"], "ready": "11/12"}
        counts = {"desired": 12, "ready": 0, "offline": 0, "completed": 11, "failed": 1}
        status = {**STATUS, "phase": "Failed", "summary": summary, "instanceCounts": counts}
        stage.add(ROBOTAPPS, robotapp(status=status))
        for number in range(12):
            phase = "Failed" if number == 7 else "Completed"
            stage.add(INSTANCES, instance(f"run-{number:02}", **{**SEEN, "phase": phase}))
        lines = stage.text("info", "teleop").splitlines()
        assert "done 11/12  12 instances: 11 completed, 1 failed" in lines[0]
        assert [line for line in lines if line.startswith("robot run-")] == ["robot run-07, domain 7, Failed"]

    def test_runs_of_a_sweep_are_counted_once(self, stage: Stage) -> None:
        counts = {"desired": 200, "ready": 3, "completed": 37, "failed": 1}
        summary = {**STATUS["summary"], "ready": "37/200 done, 1 failed"}
        app = robotapp(status={**STATUS, "summary": summary, "instanceCounts": counts})
        app["spec"]["matrix"] = {"parameters": [{"name": "seed", "values": ["1", "2"]}]}
        stage.add(ROBOTAPPS, app)
        head = stage.text("info", "teleop").splitlines()[0]
        assert "Running  200 runs: 3 ready, 37 completed, 1 failed  " in head
        assert "37/200 done, 1 failed" in stage.text("list")

    def test_while_some_run_they_are_counted_beside_those_that_have_ended(self, stage: Stage) -> None:
        counts = {"desired": 12, "ready": 3, "offline": 0, "completed": 5, "failed": 0}
        stage.add(ROBOTAPPS, robotapp(status={**STATUS, "instanceCounts": counts}))
        assert "12 instances: 3 ready, 5 completed" in stage.text("info", "teleop")


class TestInfoOfAFleet:
    """An app of many robots: what is wrong in full, what is well as a line each."""

    @pytest.fixture
    def fleet(self, stage: Stage) -> Stage:
        troubled = [
            {"instance": "bot-13", "reason": "RobotNodeUnclear", "message": "bot-13 has two nodes"},
            {"instance": "bot-02", "reason": "ComponentsNotReady", "message": "panel waits"},
        ]
        counts = {"desired": 30, "ready": 28, "failed": 1, "offline": 1}
        stage.add(ROBOTAPPS, robotapp(status={**STATUS, "instanceCounts": counts, "troubled": troubled}))
        for number in range(30):
            phase = {13: "Failed", 2: "Degraded"}.get(number, "Running")
            stage.add(INSTANCES, instance(f"bot-{number:02}", **{**SEEN, "phase": phase}))
        return stage

    def test_the_troubled_ones_come_first_and_in_full(self, fleet: Stage) -> None:
        lines = fleet.text("info", "teleop").splitlines()
        assert "instances 28/30 ready, 1 offline, 1 failed" in lines[0]
        heads = [line for line in lines if line.startswith("robot ")]
        assert heads == ["robot bot-13, domain 7, Failed", "robot bot-02, domain 7, Degraded"]
        assert "  RobotNodeUnclear: bot-13 has two nodes" in lines

    def test_the_others_are_a_line_each_with_how_to_see_more(self, fleet: Stage) -> None:
        text = fleet.text("info", "teleop")
        rows = [line.split() for line in text.splitlines() if line.startswith("bot-")]
        assert len(rows) == 28
        assert rows[0] == ["bot-00", "2/2", "Running", "7", "18/30ms", "1/1", "amr-07"]
        assert "kubectl robotapp info teleop --robot bot-00; all of them: -o wide" in text

    def test_one_robot_or_all_of_them_can_be_asked_for(self, fleet: Stage) -> None:
        text = fleet.text("info", "teleop", "--robot", "bot-05")
        assert [line for line in text.splitlines() if "bot-" in line] == ["robot bot-05, domain 7, Running"]
        assert fleet.text("info", "teleop", "-o", "wide").count("robot bot-") == 30

    def test_not_more_than_ten_are_shown_in_full(self, stage: Stage) -> None:
        stage.add(ROBOTAPPS, robotapp(status=STATUS))
        stage.add(INSTANCES, *(instance(f"bot-{number:02}", phase="Offline") for number in range(12)))
        text = stage.text("info", "teleop")
        assert text.count("robot bot-") == 10 + 1, "ten heads and the hint"
        assert [line.split()[0] for line in text.splitlines() if line.startswith("bot-")] == ["bot-10", "bot-11"]
