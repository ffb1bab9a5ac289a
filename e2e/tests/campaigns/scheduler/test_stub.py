"""The free API server is believed by our own client, and what the bench says of a row is true."""

from pathlib import Path

import msgspec
import pytest

from campaigns.free_api import objects
from campaigns.free_api.rig import Rig
from campaigns.scheduler.stub import OWN, REUSED, Target, burst, report
from robotapp_scheduler.core.api.core_v1 import Node, Pod


@pytest.mark.parametrize("template", [objects.PENDING, objects.BOUND, objects.RUNNING])
def test_pods_are_of_real_size_and_decode_as_what_they_were_asked_to_be(template: bytes) -> None:
    encoded = objects.pod(template, 7, version=42, node="node-00003", shape=5)
    pod = msgspec.json.decode(encoded, type=Pod)
    assert (pod.metadata.name, pod.metadata.resource_version) == ("pod-000007", "42")
    assert pod.spec.node_name == ("" if template is objects.PENDING else "node-00003")
    assert pod.spec.containers[0].resources.requests == {"cpu": "100m", "memory": "102405Ki"}
    assert 4_500 < len(encoded) < 7_500
    assert b"@" not in encoded.replace(b"@sha256", b"")


def test_nodes_have_what_a_rule_reads() -> None:
    node = msgspec.json.decode(objects.node(12), type=Node)
    assert node.metadata.name == "node-00012"
    assert node.metadata.labels is not None
    assert node.metadata.labels["topology.kubernetes.io/zone"] == "zone-2"


def test_a_target_is_missed_on_its_own_side_only() -> None:
    assert REUSED[0].missed(3999)
    assert not REUSED[0].missed(4000)
    assert OWN[0].missed(501)
    assert not OWN[0].missed(500)
    assert str(Target("x", 4, most=False)) == "≥ 4"


def test_the_table_names_what_was_missed() -> None:
    row = {"name": "1 class", "figures": {"pods/s": 3000.0, "p99 ms": 2.0}, "missed": ["pods/s 3e+03, wanted ≥ 4000"]}
    text = report({"options": {"rate": 300.0}, "rows": [row]})
    assert "missed by 1 class: pods/s 3e+03" in text
    assert "300 pods/s, event → binding: p99 ms 2.00" in text


async def test_the_real_process_binds_every_pod_once_and_writes_an_event_for_each(tmp_path: Path) -> None:
    async with Rig(tmp_path, nodes=30, placed=700) as rig:
        figures = await burst(rig, 120, classes=3)
        found = await rig.report()
        assert (found["bound"], found["rebound"], found["events"], found["nodes_used"]) == (120, 0, 120, 30)
        assert len(found["waited_ms"]) == 120
        assert figures["CPU µs/pod"] > 0
