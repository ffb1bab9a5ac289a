"""The screen of one app."""

import msgspec
from tests.unit.console.objects import NOW_S, app, instance, node, snapshot, telemetry, timestamp

from robotapp_console.views.app.page import MOST_IN_FULL, AppView, EdgeRow, build_app, build_events
from robotapp_console.views.objects import Event
from robotapp_console.views.snapshot import Snapshot


def edge(**fields: object) -> dict[str, object]:
    return {"topic": "/cmd_vel", "from": "ui", "to": "driver", "budget": "30ms", "nodes": ["e1", "r1"], **fields}


def view(world: Snapshot, robot: str = "") -> AppView:
    shown = build_app(world, "default", "teleop", robot)
    assert shown is not None
    return shown


def edges_of(*edges: dict[str, object]) -> tuple[EdgeRow, ...]:
    world = snapshot(
        apps=[app("teleop")],
        instances=[instance("teleop", "r1", edges=list(edges))],
        nodes=[node("e1", zone="hall"), node("r1", zone="hall"), node("c1", zone="cloud"), node("c2", zone="cloud")],
        reports=[telemetry("r1", rtt={"e1": 2.0, "c1": 60.0}, written_s=NOW_S)],
    )
    return view(world).instances[0].edges


def test_an_edge_has_its_time_its_budget_and_how_the_time_is_known() -> None:
    measured, same, lost, estimated, unknown = edges_of(
        edge(p95="18ms", measured=True, met=True),
        edge(p95="50us", met=True, nodes=["e1", "e1"]),
        edge(measured=True, met=False),
        edge(nodes=["c2", "r1"]),
        edge(nodes=[]),
    )
    assert (measured.time, measured.budget, measured.share, measured.verdict, measured.how_known) == (
        "18 ms",
        "30 ms",
        60,
        "met",
        "measured",
    )
    assert same.how_known == "same node"
    assert (lost.time, lost.share, lost.verdict) == ("unreachable", None, "exceeded")
    assert (estimated.time, estimated.how_known, estimated.share) == ("60 ms", "estimated (cloud, hall)", 200)
    assert (unknown.time, unknown.how_known, unknown.verdict) == ("", "unknown", "")


def test_a_budget_for_the_median_is_judged_by_the_verdict_alone() -> None:
    spec = edge(latency={"percentile": 50})
    world = snapshot(
        apps=[app("teleop") | {"spec": {"edges": [spec]}}],
        instances=[instance("teleop", edges=[edge(p95="40ms", measured=True, met=True)])],
    )
    (row,) = view(world).instances[0].edges
    assert (row.budget, row.share, row.verdict) == ("30 ms, median", None, "met")


def test_conditions_are_coloured_by_what_is_good_of_them() -> None:
    conditions = [
        {"type": "Ready", "status": "True", "reason": "R"},
        {"type": "Stalled", "status": "False", "reason": "R"},
        {"type": "Progressing", "status": "True", "reason": "R"},
        {"type": "BudgetMet", "status": "False", "reason": "R"},
        {"type": "Placed", "status": "Unknown", "reason": "R"},
    ]
    body = app("teleop")
    body["status"]["conditions"] = conditions
    rows = view(snapshot(apps=[body])).conditions
    assert [row.colour for row in rows] == ["good", "good", "busy", "bad", "busy"]


def test_components_show_node_restarts_message_and_moves() -> None:
    body = instance("teleop", components=[{"name": "driver", "node": "r1", "restarts": 3, "message": "waits"}])
    body["status"]["moves"] = [{"component": "driver", "times": [timestamp(NOW_S - 60), timestamp(NOW_S - 30)]}]
    (row,) = view(snapshot(apps=[app("teleop")], instances=[body])).instances[0].components
    assert (row.name, row.node, row.state, row.restarts, row.message) == ("driver", "r1", "no", 3, "waits")
    assert (row.moved_at, row.moves) == (timestamp(NOW_S - 30), 2)


def test_a_suspended_component_is_no_trouble_and_waits_for_no_node() -> None:
    body = app("teleop")
    body["spec"] = {"components": [{"name": "viewer", "replicas": 0}, {"name": "mapper"}, {"name": "driver"}]}
    components = [
        {"name": "viewer", "message": "suspended (replicas: 0)"},
        {"name": "mapper", "message": "waits until viewer (suspended by replicas: 0) is Ready (dependsOn)"},
        {"name": "driver", "node": "r1"},
    ]
    world = snapshot(apps=[body], instances=[instance("teleop", components=components)])
    rows = view(world).instances[0].components
    assert [(row.name, row.place, row.state, row.colour) for row in rows] == [
        ("viewer", "none", "suspended", "idle"),
        ("mapper", "waits", "no", "busy"),
        ("driver", "r1", "no", "bad"),
    ]


def test_with_its_app_each_component_is_suspended_as_soon_as_it_has_left_its_node() -> None:
    body = app("teleop", phase="Suspended")
    body["spec"] = {"suspend": True, "components": [{"name": "driver"}, {"name": "viewer"}]}
    components = [{"name": "driver", "node": "r1"}, {"name": "viewer"}]
    rows = view(snapshot(apps=[body], instances=[instance("teleop", components=components)])).instances[0].components
    assert [row.state for row in rows] == ["no", "suspended"]


def test_of_many_instances_the_troubled_are_shown_in_full_and_all_are_listed() -> None:
    world = snapshot(
        apps=[app("teleop", troubled=[{"instance": "r07", "reason": "CrashLoop", "message": "m"}])],
        instances=[instance("teleop", f"r{i:02}") for i in range(20)]
        + [instance("teleop", "other", app_uid="u-other")],
    )
    shown = view(world)
    assert len(shown.instances) == MOST_IN_FULL
    assert shown.instances[0].name == "r07"
    assert [line.name for line in shown.lines][:3] == ["r07", "r00", "r01"]
    assert len(shown.lines) == 20
    assert shown.problems[0].command.endswith("--tail=50")


def test_a_sweep_shows_how_many_of_its_runs_are_done_failed_and_at_work() -> None:
    body = app("teleop")
    body["spec"] = {"matrix": {"parameters": [{"name": "seed", "values": ["1", "2"]}]}}
    body["status"]["summary"] = {"ready": "37/200 done, 1 failed"}
    body["status"]["instanceCounts"] = {"desired": 200, "ready": 3, "completed": 37, "failed": 1}
    phases = {"a": "Completed", "b": "Failed", "c": "Running"}
    shown = view(snapshot(apps=[body], instances=[instance("teleop", key, phase=phases[key]) for key in phases]))
    assert shown.facts[:2] == (("runs", "37/200 done, 1 failed"), ("runs at work", "3"))
    assert not [label for label, _ in shown.facts if label.startswith("instances")]
    assert shown.is_sweep
    assert [line.name for line in shown.lines] == ["b", "a", "c"], "what has completed is in no trouble"
    assert [each.message for each in shown.instances if each.name == "a"] == [""]


def test_a_job_that_has_completed_is_done_waits_for_no_node_and_has_commands_for_runs() -> None:
    body = app("teleop") | {"spec": {"components": [{"name": "save", "job": {}}, {"name": "driver"}]}}
    components = [{"name": "save", "ready": True, "completed": True}, {"name": "driver", "ready": True, "node": "r1"}]
    shown = view(snapshot(apps=[body], instances=[instance("teleop", components=components)]))
    save, driver = shown.instances[0].components
    assert (save.state, save.colour, save.place, save.wants_node, save.is_job) == ("done", "good", "none", False, True)
    assert (driver.state, driver.is_job) == ("yes", False)
    assert "kubectl robotapp runs teleop -n default --failed" in [command.line for command in shown.commands]
    plain = view(snapshot(apps=[app("teleop")]))
    assert not [command for command in plain.commands if "runs" in command.line]


def test_an_app_whose_jobs_all_have_a_schedule_has_no_command_that_repeats_them() -> None:
    upload = {"name": "upload", "job": {}, "schedule": {"cron": "@daily"}}
    shown = view(snapshot(apps=[app("teleop") | {"spec": {"components": [upload]}}], instances=[instance("teleop")]))
    lines = [command.line for command in shown.commands]
    assert "kubectl robotapp runs teleop -n default" in lines
    assert not [line for line in lines if "--failed" in line]


def test_one_instance_can_be_chosen_and_a_missing_one_is_told() -> None:
    world = snapshot(apps=[app("teleop")], instances=[instance("teleop", f"r{i}") for i in range(20)])
    assert [item.name for item in view(world, "r13").instances] == ["r13"]
    assert view(world, "r13").commands[0].line == "kubectl robotapp info teleop -n default --robot r13"
    assert view(world, "nobody").missing
    assert not view(world).missing


def test_there_is_no_page_of_an_app_that_is_not_there() -> None:
    assert build_app(snapshot(), "default", "teleop") is None


def test_a_change_that_the_operator_has_not_seen_is_told() -> None:
    body = app("teleop")
    body["metadata"]["generation"] = 2
    assert view(snapshot(apps=[body])).outdated


def test_the_newest_event_comes_first() -> None:
    bodies = [
        {"metadata": {"name": "a"}, "reason": "Old", "eventTime": timestamp(NOW_S - 100)},
        {
            "metadata": {"name": "b"},
            "reason": "New",
            "eventTime": timestamp(NOW_S - 200),
            "series": {"count": 4, "lastObservedTime": timestamp(NOW_S)},
        },
        {
            "metadata": {"name": "c"},
            "reason": "Older",
            "eventTime": None,
            "deprecatedLastTimestamp": timestamp(NOW_S - 300),
        },
    ]
    rows = build_events(msgspec.convert(body, Event) for body in bodies)
    assert [(row.reason, row.count) for row in rows] == [("New", 4), ("Old", 1), ("Older", 1)]
