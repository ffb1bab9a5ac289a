import json

import pytest

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.annotations import MAX_BYTES, parse_annotations
from robotapp_scheduler.core.api.ros import Hardware, InvalidAnnotation, RosRequest

POLICIES, TOPOLOGY = Annotation.POLICIES, Annotation.TOPOLOGY
AFFINITY, SHARED, DOMAIN = Annotation.AFFINITY, Annotation.SHARED_DATA, Annotation.DDS_DOMAIN


def refused(key: str, text: str) -> InvalidAnnotation:
    found = parse_annotations({str(key): text})
    assert isinstance(found, InvalidAnnotation), found
    assert found.key == key
    return found


def test_a_pod_without_ros_annotations_asks_for_nothing() -> None:
    assert parse_annotations({"other": "x"}) is None


def test_the_thesis_example_is_read_without_loss() -> None:
    found = parse_annotations(
        {
            POLICIES: '{"latency_budget":"30ms","qos_class":"realtime","reliability":"reliable","deadline":"50ms"}',
            TOPOLOGY: '{"master_node":"","preferred_zones":["edge-1", "edge-2"]}',
            AFFINITY: '{"hardware_requirements":[{"type":"gpu","model":"nvidia"},{"type":"can","interface":"can0"}]}',
            SHARED: '{"peer_pods":["slam-mapper"],"pvc":["map"]}',
            DOMAIN: "auto",
        }
    )
    assert found == RosRequest(
        latency_budget_us=30_000,
        deadline_us=50_000,
        qos_class="realtime",
        reliability="reliable",
        zones=("edge-1", "edge-2"),
        hardware=(Hardware("gpu", "nvidia"), Hardware("can", interface="can0")),
        peer_pods=("slam-mapper",),
        volume_claims=("map",),
        dds_domain="auto",
    )


def test_fields_that_only_ros_reads_are_checked_and_null_counts_as_absent() -> None:
    text = '{"durability":"transient_local","queue_size":1,"tcp_nodelay":true,"deadline":null}'
    assert parse_annotations({POLICIES: text}) == RosRequest()


@pytest.mark.parametrize(
    ("key", "text", "field", "allowed"),
    [
        (POLICIES, '{"latency_budget":"30"}', "latency_budget", "such as 30ms"),
        (POLICIES, '{"latency_budget":30}', "latency_budget", "such as 30ms"),
        (POLICIES, '{"latency_budget":"-5ms"}', "latency_budget", "positive duration"),
        (POLICIES, '{"deadline":"0ms"}', "deadline", "positive duration"),
        (POLICIES, '{"deadline":""}', "deadline", "positive duration"),
        (POLICIES, '{"qos_class":"fast"}', "qos_class", "realtime, sensor_data, system_default, best_effort"),
        (POLICIES, '{"qos_class":["realtime"]}', "qos_class", "one of"),
        (POLICIES, '{"reliability":"maybe"}', "reliability", "reliable, best_effort"),
        (POLICIES, '{"queue_size":-1}', "queue_size", "from 0"),
        (POLICIES, '{"queue_size":true}', "queue_size", "integer"),
        (POLICIES, '{"tcp_nodelay":"yes"}', "tcp_nodelay", "true or false"),
        (POLICIES, '{"latencyBudget":"30ms"}', "latencyBudget", "latency_budget"),
        (POLICIES, '{"deadline":"1s","deadline":"2s"}', "deadline", "each field once"),
        (POLICIES, '{"queue_size":NaN}', "", "NaN"),
        (POLICIES, '{"queue_size":99999999999999999999999}', "", "9 digits"),
        (POLICIES, '{"queue_size":1e400}', "", "1e9"),
        (POLICIES, '{"formatVersion":2}', "formatVersion", "latency_budget"),
        (POLICIES, "", "", "a JSON object"),
        (POLICIES, "[]", "", "a JSON object"),
        (POLICIES, '{"deadline":"1s"', "", "a JSON object"),
        (POLICIES, '{"deadline":"1s"} x', "", "a JSON object"),
        (POLICIES, "[" * 5000, "", "levels of nesting"),
        (POLICIES, '{"x":"' + "a" * MAX_BYTES + '"}', "", "8192 bytes"),
        (POLICIES, '{"x":"' + "ü" * 4100 + '"}', "", "8192 bytes"),
        (TOPOLOGY, '{"preferred_zones":"edge"}', "preferred_zones", "at most 32 strings"),
        (TOPOLOGY, '{"preferred_zones":["a",""]}', "preferred_zones[1]", "non-empty"),
        (TOPOLOGY, json.dumps({"preferred_zones": ["z"] * 33}), "preferred_zones", "at most 32"),
        (TOPOLOGY, json.dumps({"master_node": "n" * 254}), "master_node", "253"),
        (AFFINITY, '{"hardware_requirements":[{"model":"x"}]}', "hardware_requirements[0].type", "device type"),
        (AFFINITY, '{"hardware_requirements":[{"type":"gpu","vendor":"x"}]}', "hardware_requirements[0].vendor", "model"),
        (AFFINITY, '{"hardware_requirements":["gpu"]}', "hardware_requirements[0]", "an object"),
        (AFFINITY, '{"hardware_requirements":{}}', "hardware_requirements", "at most 32"),
        (SHARED, '{"peer_pods":[7]}', "peer_pods[0]", "string"),
        (DOMAIN, "233", "", '"auto" or a number of 1-101,215-232'),
        *[(DOMAIN, unsafe, "", '"auto" or a number of 1-101,215-232') for unsafe in ("0", "00", "102", "150", "214")],
        (DOMAIN, "-1", "", '"auto"'),
        (DOMAIN, "٣", "", '"auto"'),
        (DOMAIN, "1" * 100_000, "", '"auto"'),
        (DOMAIN, "", "", '"auto"'),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_field_value_and_what_is_allowed(
    key: str, text: str, field: str, allowed: str
) -> None:
    found = refused(key, text)
    assert found.field == field
    assert allowed in found.allowed
    assert len(found.value) <= 80
    assert found.message.startswith(f"annotation {key}")
    assert len(found.message) < 500


@pytest.mark.parametrize(
    ("text", "expected"),
    [("7", "7"), (" 007 ", "7"), ("1", "1"), ("101", "101"), ("215", "215"), ("232", "232"), ("auto", "auto")],
)
def test_domains_are_auto_or_a_number(text: str, expected: str) -> None:
    assert parse_annotations({DOMAIN: text}) == RosRequest(dds_domain=expected)
