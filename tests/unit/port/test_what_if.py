"""The statuses of answers to what-if, and that a user is shown no more than it may see."""

import json
from typing import Any

import msgspec
import pytest
from tests.support.scheduling import make_core, make_node, make_pod, owner, telemetry

from robotapp_api.model.names import API_VERSION, Label
from robotapp_scheduler.config.load import built_in
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.forked_worker import ForkedWorker
from robotapp_scheduler.port.frames import Request
from robotapp_scheduler.port.what_if import WhatIf
from robotapp_scheduler.shell.config.reload import Running


@pytest.fixture
def core() -> SchedulerCore:
    core = make_core(make_node("n1"), make_node("n2"))
    for namespace in ("team-a", "team-b"):
        core.cluster.apply_pod(
            make_pod(namespace, namespace=namespace, node="n1", owner=owner("ReplicaSet", "rs", "rs-1"))
        )
    return core


def ask(core: SchedulerCore, asked: Any, namespace: str = "", *, with_nodes: bool = True) -> tuple[int, Any]:
    body = json.dumps(asked).encode()
    request = Request("what-if", namespace=namespace, with_nodes=with_nodes, body=body)
    status, found = WhatIf(core, Running(built_in(catalogue())))(request)
    return status, json.loads(found)


def test_pods_of_others_are_counted(core: SchedulerCore) -> None:
    status, found = ask(core, {"nodeLoss": ["n1"]}, "team-a")
    assert status == 200
    assert [(each["pod"], each["from"], each["to"]) for each in found["pods"]] == [("team-a", "n1", "n2")]
    assert found["hidden"] == {"pods": 1, "edges": 0}
    assert "team-b" not in json.dumps(found)


@pytest.mark.parametrize(
    ("asked", "status", "text"),
    [
        ({"nodeLoss": ["n3"]}, 422, "there is no node 'n3'"),
        ({"nodeLoss": 3}, 400, "$.nodeLoss"),
        ({"config": {"kind": "KubeSchedulerConfiguration", "apiVersion": "x"}}, 400, "cannot be used"),
        ({"config": {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration", "profiles":
            [{"plugins": {"multiPoint": {"enabled": [{"name": "os:system"}]}}}]}}, 400, "cannot be used"),
    ],
)  # fmt: skip
def test_a_mistake_of_the_user_is_a_sentence(core: SchedulerCore, asked: Any, status: int, text: str) -> None:
    found = ask(core, asked)
    assert (found[0], text in found[1]["error"]) == (status, True)


def test_a_budget_that_is_held_names_no_node_to_who_may_not_get_nodes() -> None:
    core = make_core(make_node("n1"), make_node("amr", labels={str(Label.ROBOT): "amr", str(Label.TIER): "robot"}))
    core.cluster.apply_telemetry(telemetry("amr", rtt_ms={"n1": 60}))
    spec = {
        "robots": {"nodeSelector": {"matchLabels": {str(Label.ROBOT): "amr"}}},
        "components": [
            {"name": "driver", "runsOn": ["Robot"]},
            {"name": "planner", "template": {"spec": {"nodeSelector": {"kubernetes.io/hostname": "n1"}}}},
        ],
        "edges": [
            {"topic": "/x", "from": "driver", "to": "planner", "latency": {"budget": "30ms", "enforce": "Preferred"}}
        ],
        "placement": {"fallback": {"steps": ["Wait"]}},
    }
    app = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "a", "namespace": "team-a"},
        "spec": spec,
    }
    _, found = ask(core, {"apps": [app]}, "team-a")
    assert "best is 60ms (measured) on n1" in found["pods"][1]["reason"]
    _, found = ask(core, {"apps": [app]}, "team-a", with_nodes=False)
    assert "best is 60ms (measured) on …" in found["pods"][1]["reason"]
    assert "n1" not in json.dumps(found)


async def test_an_app_that_would_take_all_memory_is_refused_and_the_scheduler_lives(core: SchedulerCore) -> None:
    """Less than 1 MiB of JSON, with the same 300,000 entries in each of 500 pods."""
    template = {"spec": {"tolerations": [{}] * 300_000}}
    spec = {"components": [{"name": "c", "replicas": 500, "template": template}]}
    app = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "a", "namespace": "team-a"},
        "spec": spec,
    }
    body = json.dumps({"apps": [app]}, separators=(",", ":")).encode()
    what_if = WhatIf(core, Running(built_in(catalogue())))
    worker = ForkedWorker(lambda asked: msgspec.msgpack.encode(what_if(Request("what-if", body=asked))), timeout_s=60)
    status, found = msgspec.msgpack.decode(await worker.request(body), type=tuple[int, bytes])
    await worker.end()
    assert (status, "takes more than 256 MiB" in json.loads(found)["error"]) == (400, True)


def test_an_answer_of_many_mib_does_not_pass_through_the_process_that_places_pods(core: SchedulerCore) -> None:
    """Every pod of the answer names its component."""
    spec = {"components": [{"name": "c" * 20_000, "replicas": 500}]}
    app = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "a", "namespace": "team-a"},
        "spec": spec,
    }
    status, found = ask(core, {"apps": [app]})
    assert (status, "more than 8 MiB" in found["error"]) == (400, True)
