"""Placements without a cluster are those of the scheduler's own core."""

import json
from typing import Any

from tests.support.scheduling import make_core, make_info, make_node, node_json, pod_json

from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import SchedulerConfig
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.simulation.dump import Reader
from robotapp_scheduler.simulation.report import as_json, as_table
from robotapp_scheduler.simulation.run import Outcome, simulate
from robotapp_scheduler.watch.routes import kinds


def config(**fields: Any) -> SchedulerConfig:
    head = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    return configuration.parse(head | fields, catalogue=catalogue())


def outcome(*objects: Any, replay: int = 0, **fields: Any) -> Outcome:
    reader = Reader(kinds())
    reader.add(json.dumps({"kind": "List", "items": list(objects)}).encode(), "test")
    return simulate(reader.dump, config(**fields), replay=replay)


def node(name: str, **fields: Any) -> Any:
    return {"kind": "Node", **node_json(name, **fields)}


def pod(name: str, *, created: str = "", **fields: Any) -> Any:
    found = {"kind": "Pod", **pod_json(name, **fields)}
    if created:
        found["metadata"]["creationTimestamp"] = created
    return found


def nodes_of(found: Outcome) -> dict[str, str | None]:
    return {placement.name: placement.node for placement in found.placements}


def test_pods_go_where_the_core_would_put_them_and_count_against_each_other() -> None:
    pods = [f"p{number}" for number in range(12)]
    found = outcome(node("a"), node("b", cpu="3"), node("c", cpu="8"), *(pod(name, cpu="1") for name in pods))
    core = make_core(make_node("a"), make_node("b", cpu="3"), make_node("c", cpu="8"))
    assert nodes_of(found) == {name: core.schedule_one(make_info(name, cpu="1")).node for name in pods}
    assert found.placed == 12


def test_the_order_is_priority_then_age_then_that_of_the_file() -> None:
    found = outcome(
        node("only", cpu="100"),
        pod("young", created="2026-01-01T00:00:09Z"),
        pod("twin-b", created="2026-01-01T00:00:05Z"),
        pod("twin-a", created="2026-01-01T00:00:05Z"),
        pod("vip", created="2026-01-01T00:00:10Z", priority=1000),
    )
    assert [placement.name for placement in found.placements] == ["vip", "twin-b", "twin-a", "young"]


def test_refused_and_held_pods_say_why_and_pods_of_others_are_counted() -> None:
    found = outcome(
        node("a", cpu="1"),
        pod("big", cpu="9"),
        pod("gated", schedulingGates=[{"name": "wait"}]),
        pod("theirs", scheduler="default-scheduler"),
        pod("done", scheduler="default-scheduler", node="a", cpu="100m"),
    )
    why = {placement.name: placement.message for placement in found.placements}
    assert why["big"].startswith("0/1 nodes are available: 1 Insufficient cpu.")
    assert "wait" in why["gated"]
    assert found.others == {"default-scheduler": 1}
    assert found.placed == 0


def test_an_object_that_several_files_hold_counts_once_and_the_last_one_is_meant() -> None:
    old, new = pod("p", cpu="9"), pod("p", cpu="1")
    foreign = pod("q", schedulerName="default-scheduler")
    found = outcome(node("a"), old, foreign, new, foreign)
    assert (nodes_of(found), found.others) == ({"p": "a"}, {"default-scheduler": 1})


def test_pods_that_run_take_room_whoever_placed_them() -> None:
    running = pod("theirs", scheduler="default-scheduler", node="a", cpu="3500m")
    assert nodes_of(outcome(node("a"), node("b", cpu="1"), running, pod("p", cpu="1"))) == {"p": "b"}


def test_replay_places_the_latest_pods_again_under_the_configuration_in_hand() -> None:
    bound = [
        pod(f"p{number}", node="spread" if number % 2 else "other", cpu="1", created=f"2026-01-01T00:00:0{number}Z")
        for number in range(4)
    ]
    args = {"scoringStrategy": {"type": "MostAllocated", "resources": [{"name": "cpu", "weight": 1}]}}
    off = {"multiPoint": {"disabled": [{"name": "NodeResourcesBalancedAllocation"}]}}
    profile = {"plugins": off, "pluginConfig": [{"name": "NodeResourcesFit", "args": args}]}
    found = outcome(node("spread", cpu="8"), node("other", cpu="8"), *bound, replay=2, profiles=[profile])
    assert sorted(nodes_of(found)) == ["p2", "p3"], "the latest two"
    assert {placement.was for placement in found.placements} == {"spread", "other"}
    assert len(set(nodes_of(found).values())) == 1, "packed on one"
    assert found.moved == 1


def test_a_manifest_without_a_uid_and_an_object_the_rules_cannot_read_harm_nobody() -> None:
    manifest = pod("new")
    del manifest["metadata"]["uid"]
    twin = json.loads(json.dumps(manifest))
    twin["metadata"]["name"] = "twin"
    found = outcome(node("good"), node("bad", cpu="a lot"), manifest, twin)
    assert nodes_of(found) == {"new": "good", "twin": "good"}
    assert any("Node /bad: left out" in problem for problem in found.problems)


def test_an_empty_dump_is_an_empty_outcome() -> None:
    found = outcome()
    assert (found.nodes, found.placements) == (0, [])
    assert "0 of 0 pods placed on 0 nodes" in as_table(found)


def test_a_terminal_obeys_nothing_that_a_dump_holds() -> None:
    lines = as_table(outcome(node("a"), pod("p\x1b]0;mine\x07\nq"))).splitlines()
    assert lines[1].split()[:3] == ["default", r"p\x1b]0;mine\x07\nq", "a"]


def test_the_report_has_a_line_per_pod_and_says_what_is_not_simulated() -> None:
    found = outcome(node("a"), node("b"), pod("p"), pod("big", cpu="9"), {"kind": "Secret"})
    lines = as_table(found).splitlines()
    assert lines[0].split() == ["NAMESPACE", "POD", "NODE", "WHY"]
    assert lines[1].split()[:2] == ["default", "p"]
    assert "best of 2 feasible nodes" in lines[1]
    assert "Insufficient cpu" in lines[2]
    assert "1 of 2 pods placed on 2 nodes" in as_table(found)
    assert "ignored, no rule reads them: 1 Secret" in as_table(found)
    assert "not simulated" in lines[-1]
    plain = as_json(found)
    assert (plain["placed"], plain["refused"], plain["ignored"]) == (1, 1, {"Secret": 1})
    assert json.loads(json.dumps(plain)) == plain


def test_a_pod_that_is_being_resized_leaves_as_much_room_as_in_the_release_that_is_asked_for() -> None:
    resized = pod("r", node="n")
    sides = {"a": ("1", "2"), "b": ("2", "1")}
    resized["spec"]["containers"] = [
        {"name": name, "resources": {"requests": {"cpu": asked}}} for name, (asked, _) in sides.items()
    ]
    resized["status"] = {
        "containerStatuses": [
            {"name": name, "resources": {"requests": {"cpu": cpu}}} for name, (_, cpu) in sides.items()
        ]
    }
    given = (node("n", cpu="4"), resized, pod("p", cpu="1"))
    assert nodes_of(outcome(*given)) == {"p": "n"}
    assert nodes_of(outcome(*given, compatVersion="1.35")) == {"p": None}


def of_app(kind: str, component: str, owned_by: tuple[str, str]) -> Any:
    """A Deployment, ReplicaSet or Pod of a component; `owned_by` is kind and uid."""
    labels = {"robotics.io/app-uid": "app", "robotics.io/component": component, "robotics.io/instance": ""}
    owner = {"kind": owned_by[0], "name": owned_by[1], "uid": owned_by[1], "controller": True}
    if kind == "Pod":
        place = {"kubernetes.io/hostname": {"left": "a", "right": "b"}[component]}
        return pod(component, labels=labels, owner=owner, nodeSelector=place)
    name = f"{kind.lower()}-{component}"
    meta = {"namespace": "default", "name": name, "uid": name, "labels": labels, "ownerReferences": [owner]}
    return {"kind": kind, "apiVersion": "apps/v1", "metadata": meta, "spec": {}}


def test_a_fallback_is_played_to_its_end() -> None:
    far = {"status": {"rtt": [{"peer": "b", "p50Us": 90_000, "p95Us": 90_000}], "intervalSeconds": 10}}
    latency = {"budget": "30ms", "enforce": "Preferred"}

    def placed(fallback: Any) -> dict[str, str | None]:
        app = {
            "kind": "RobotApp",
            "metadata": {"name": "app", "namespace": "default", "uid": "app", "generation": 1},
            "spec": {
                "components": [{"name": "left"}, {"name": "right"}],
                "edges": [{"topic": "/t", "from": "left", "to": "right", "latency": latency}],
                "placement": {"fallback": fallback},
            },
            "status": {"observedGeneration": 1},
        }
        children = [
            each
            for name in ("left", "right")
            for each in (
                of_app("Deployment", name, ("RobotApp", "app")),
                of_app("ReplicaSet", name, ("Deployment", f"deployment-{name}")),
                of_app("Pod", name, ("ReplicaSet", f"replicaset-{name}")),
            )
        ]
        telemetry = {"kind": "NodeTelemetry", "metadata": {"name": "a"}, **far}
        return nodes_of(outcome(node("a"), node("b"), app, telemetry, *children))

    assert placed({"after": "10s"}) == {"left": "a", "right": "b"}
    assert placed({"steps": ["Wait"]}) == {"left": None, "right": None}
