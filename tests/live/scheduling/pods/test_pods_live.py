"""Ordinary pods: bound, refused with upstream's words, brought back by what helps them, never lost."""

import json
import time
import urllib.request

import pytest

from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.machines.nodes import edge
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live


def explain(scheduler: Process, namespace: str, name: str) -> dict[str, object]:
    url = f"{scheduler.health_url}/explain/{namespace}/{name}"
    with urllib.request.urlopen(url, context=unverified()) as answer:  # noqa: S310 - our own
        found: dict[str, object] = json.load(answer)
    return found


def test_a_pod_is_bound_with_one_event_and_runs(
    installed_plane: ControlPlane, scheduler: Process, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("plain"))
        assert stage.wait_bound("plain") == "edge-1"
        event = stage.wait_event("plain", reason="Scheduled")
        assert event["note"] == f"Successfully assigned {stage.namespace}/plain to edge-1"
        assert (event["action"], event["type"]) == ("Binding", "Normal")
        assert event["reportingController"] == "ros-aware-scheduler"
        stage.wait(lambda: stage.pod("plain")["status"]["phase"] == "Running", what=lambda: "not running")
        assert explain(scheduler, stage.namespace, "plain")["node"] == "edge-1"


@pytest.mark.usefixtures("scheduler")
def test_the_thesis_scheduler_name_is_served_too(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("thesis", scheduler="kubernetes-scheduler"))
        assert stage.wait_bound("thesis") == "edge-1"
        event = stage.wait_event("thesis", reason="Scheduled")
        assert event["reportingController"] == "kubernetes-scheduler"


@pytest.mark.usefixtures("scheduler")
def test_a_pod_nobody_can_take_says_why_and_a_new_node_takes_it_at_once(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1", cpu="2")):
        stage.wait_known("edge-1")
        stage.create_pod(pod("big", requests={"cpu": "3"}))
        message = stage.wait_refused("big", reason="Unschedulable")
        assert message == (
            "0/1 nodes are available: 1 Insufficient cpu. preemption: 0/1 nodes are available: "
            "1 Preemption is not helpful for scheduling."
        )
        assert stage.wait_event("big", reason="FailedScheduling")["note"] == message
        with nodes(installed_plane, edge("edge-1", cpu="2"), edge("edge-2", cpu="8")):
            assert stage.wait_bound("big") == "edge-2"  # unasked it would be tried again after five minutes


@pytest.mark.usefixtures("scheduler")
def test_the_condition_is_written_once_however_often_the_pod_is_tried(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1", cpu="2")):
        stage.wait_known("edge-1")
        stage.create_pod(pod("big", requests={"cpu": "3"}))
        stage.wait_refused("big", reason="Unschedulable")
        stage.wait_event("big", reason="FailedScheduling")
        version = stage.pod("big")["metadata"]["resourceVersion"]
        for number in range(10):  # each one placed and removed wakes the waiting pod
            stage.create_pod(pod(f"other-{number}"))
            stage.wait_bound(f"other-{number}")
            stage.delete_pod(f"other-{number}")
        assert stage.pod("big")["metadata"]["resourceVersion"] == version
        assert len([event for event in stage.events("big") if event["reason"] == "FailedScheduling"]) == 1


def seconds_until_bound(stage: Stage, name: str) -> float:
    started = time.monotonic()
    stage.create_pod(pod(name))
    stage.wait_bound(name)
    return time.monotonic() - started


ROUNDS = 3
"""Poison would hold up whoever comes behind it every time, a busy machine only now and then."""
POISON = {
    "not-json": ("policies", "{"),
    "wrong-unit": ("policies", json.dumps({"latency_budget": "30 parsecs"})),
    "unknown-field": ("policies", json.dumps({"latencyBudget": "30ms"})),
    "too-deep": ("affinity", "[" * 5000),
    "too-large": ("topology", json.dumps({"master_node": "x" * 9000})),
    "no-such-domain": ("dds-domain", "9000"),
}


def seconds_behind_poison(stage: Stage, attempt: int) -> float:
    """What a healthy pod waits when one of each poison was sent before it."""
    for what, (key, value) in POISON.items():
        stage.create_pod(pod(f"poison-{attempt}-{what}", annotations={f"scheduler.robotics.io/{key}": value}))
    return seconds_until_bound(stage, f"healthy-{attempt}")


@pytest.mark.usefixtures("scheduler")
def test_poison_annotations_are_refused_by_name_and_hold_nobody_up(installed_plane: ControlPlane, stage: Stage) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.wait_known("edge-1")
        undisturbed_s = seconds_until_bound(stage, "first")
        behind_s = [seconds_behind_poison(stage, attempt) for attempt in range(ROUNDS)]
        assert min(behind_s) < max(1.0, 3 * undisturbed_s)
        for name, (key, _) in ((f"poison-{each}-{what}", POISON[what]) for each in range(ROUNDS) for what in POISON):
            message = stage.wait_refused(name, reason="InvalidAnnotation")
            assert f"scheduler.robotics.io/{key}" in message
            assert "allowed:" in message


@pytest.mark.usefixtures("scheduler")
def test_a_corrected_annotation_is_taken_at_once(installed_plane: ControlPlane, stage: Stage) -> None:
    key = "scheduler.robotics.io/policies"
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(pod("typo", annotations={key: json.dumps({"latency_budget": "30"})}))
        stage.wait_refused("typo", reason="InvalidAnnotation")
        annotations = {key: json.dumps({"latency_budget": "30ms"})}
        installed_plane.api.patch(f"{stage.pods_path}/typo", {"metadata": {"annotations": annotations}})
        stage.wait_bound("typo")


@pytest.mark.usefixtures("scheduler")
def test_a_node_is_seen_whatever_lists_of_it_are_empty(installed_plane: ControlPlane, stage: Stage) -> None:
    """Empty lists come as null where their field is always written: names of an image left behind, drivers of a CSINode."""
    api, node = installed_plane.api, edge(f"{stage.namespace}-bare", labels={"test/bare": stage.namespace})
    with nodes(installed_plane, node):
        csi = {
            "apiVersion": "storage.k8s.io/v1",
            "kind": "CSINode",
            "metadata": {"name": node.name},
            "spec": {"drivers": []},
        }
        api.create("/apis/storage.k8s.io/v1/csinodes", csi)
        api.patch(f"/api/v1/nodes/{node.name}/status", {"status": {"images": [{"names": [], "sizeBytes": 5}]}})
        assert api.get(f"/api/v1/nodes/{node.name}")["status"]["images"] == [{"names": None, "sizeBytes": 5}]
        stage.create_pod(pod("bare", nodeSelector={"test/bare": stage.namespace}))
        assert stage.wait_bound("bare") == node.name
        api.delete(f"/apis/storage.k8s.io/v1/csinodes/{node.name}")
