"""The process behind /simulate: its limits, and which plugins a sent configuration may bring."""

import io
import json
from typing import Any

import msgspec
import pytest
from tests.support.scheduling import node_json, pod_json

from robotapp_scheduler.simulation.worker import Order, answer

HEAD = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
OURS = "tests.support.scheduler.third_party_plugin:PreferQuietNodes"


def ask(body: Any, **order: Any) -> Any:
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    return answer(io.BytesIO(msgspec.json.encode(Order(**order)) + b"\n" + content))


def cluster(**fields: Any) -> Any:
    return {"kind": "List", "items": [{"kind": "Node", **node_json("n")}, {"kind": "Pod", **pod_json("p")}], **fields}


def plugin(name: str) -> Any:
    return HEAD | {"profiles": [{"plugins": {"score": {"enabled": [{"name": name}]}}}]}


def test_the_running_configuration_is_used_unless_the_dump_brings_one() -> None:
    assert ask(cluster())["placed"] == 1
    other = HEAD | {"profiles": [{"schedulerName": "other"}]}
    assert ask(cluster(), config=json.dumps(other))["otherSchedulers"] == {"ros-aware-scheduler": 1}
    assert ask(cluster(config=HEAD), config=json.dumps(other))["placed"] == 1


def test_a_sent_configuration_imports_only_what_the_running_one_does() -> None:
    refused = ask(cluster(config=plugin(OURS)))
    assert "not loaded here" in refused["problems"][0]
    assert ask(cluster(config=plugin(OURS)), third_party=[OURS])["placed"] == 1
    assert ask(cluster(), config=json.dumps(plugin(OURS)))["placed"] == 1


def test_what_the_caller_did_wrong_is_an_error_with_the_reason() -> None:
    assert ask(cluster(config={"typo": 1}))["error"] == "the configuration cannot be used"
    assert "no JSON" in ask(b"kind: Pod")["error"]
    assert "no JSON" in ask(b"[" * 100_000)["error"]


@pytest.mark.parametrize("body", [b"", b" \n"])
def test_an_empty_body_is_told_what_is_expected_and_how_to_make_it(body: bytes) -> None:
    error = ask(body)["error"]
    assert error.startswith("body of the request: nothing in it; a dump is a List of Kubernetes objects")
    assert "kubectl get nodes,pods -A -o json" in error


@pytest.mark.parametrize(
    "body", [b"kind: Pod", b'{"kind": "List", "items": [', b"[]", b"3", b"\xff\xfe", b'{"config": ']
)
def test_a_body_that_is_no_dump_is_told_what_is_expected_and_how_to_make_it(body: bytes) -> None:
    error = ask(body)["error"]
    assert error.startswith("body of the request: no JSON of Kubernetes objects (")
    assert "kubectl get nodes,pods -A -o json" in error


@pytest.mark.parametrize("depth", [100, *range(200, 1200, 50), 5000])
def test_a_configuration_of_any_depth_in_a_dump_is_an_answer(depth: int) -> None:
    assert "error" in ask(b'{"items": [], "config": ' + b'{"a":' * depth + b"1" + b"}" * depth + b"}")


def test_replay_is_passed_on() -> None:
    body = cluster()
    body["items"][1]["spec"]["nodeName"] = "n"
    assert ask(body, replay=1)["placements"][0]["was"] == "n"
