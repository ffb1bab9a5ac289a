"""The orchestration block: every field of the scheduler block, our own words, what is refused."""

import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.rigelfiles import ONE, TWO, orchestration, refusal, rendered, spec

from rigel_bridge.failures import BridgeError


def component(block: str) -> dict[str, object]:
    found: dict[str, object] = spec(orchestration(block))["components"][0]
    return found


@pytest.mark.parametrize(
    ("policies", "expected"),
    [
        ("latency_budget: 30ms", {"policies": {"latencyBudget": "30ms"}}),
        ("deadline: 50ms", {"policies": {"deadline": "50ms"}}),
        ("reliability: best_effort", {"policies": {"reliability": "best_effort"}}),
        ("durability: transient_local", {"policies": {"durability": "transient_local"}}),
        ("liveliness: manual_by_topic", {"policies": {"liveliness": "manual_by_topic"}}),
        ("queue_size: 5", {"policies": {"queueSize": 5}}),
        ("tcp_nodelay: true", {"policies": {"tcpNodelay": True}}),
        ("qos_class: sensor_data", {"qosClass": "sensor_data"}),
    ],
)
def test_every_policy_of_the_thesis_has_its_field(policies: str, expected: dict[str, object]) -> None:
    found = component(f"scheduler: {{policies: {{{policies}}}}}")
    assert {key: found[key] for key in expected} == expected


def test_topology_and_the_schedulers_name_belong_to_the_app() -> None:
    found = spec(
        orchestration(
            "scheduler: {name: kubernetes-scheduler, topology: {master_node: edge-1, preferred_zones: [a, b]}}"
        )
    )
    assert found["schedulerName"] == "kubernetes-scheduler"
    assert found["placement"] == {"masterNode": "edge-1", "zones": ["a", "b"]}


def test_an_empty_master_node_and_no_zones_say_nothing() -> None:
    assert "placement" not in spec(orchestration('scheduler: {topology: {master_node: "", preferred_zones: []}}'))


def test_hardware_is_claimed_where_it_can_have_one_owner_and_required_otherwise() -> None:
    found = component(
        "scheduler: {affinity: {hardware_requirements: [{type: can, interface: can0}, {type: can}, {type: usb, model: cam}, {type: gpu, model: nvidia}]}}"
    )
    assert found["devices"] == [
        {"name": "can", "type": "can", "interface": "can0"},
        {"name": "can-2", "type": "can"},
        {"name": "usb", "type": "usb", "model": "cam"},
    ]
    assert found["requires"] == [{"type": "gpu", "model": "nvidia"}]


def test_peers_inside_the_app_are_told_from_foreign_ones() -> None:
    block = "components: {operator_ui: {scheduler: {shared_data: {peer_pods: [base_driver, mapper], pvc: [map-pvc]}}}}"
    found = spec(orchestration(block, TWO))["components"][1]
    assert found["sharedData"] == {"with": ["base-driver"], "peerPods": ["mapper"], "claims": ["map-pvc"]}


@pytest.mark.parametrize("key", ["shared_data", "shared-data"])
def test_shared_data_in_both_spellings(key: str) -> None:
    assert component(f"scheduler: {{{key}: {{pvc: [p]}}}}")["sharedData"] == {"claims": ["p"]}


@pytest.mark.parametrize(("text", "domain"), [("auto", None), ("7", 7), ('"12"', 12), ("215", 215)])
def test_the_domain_is_allocated_or_asked_for(text: str, domain: int | None) -> None:
    assert spec(orchestration(f"scheduler: {{dds_domain: {text}}}")).get("dds", {}).get("domain") == domain


def test_the_common_block_holds_for_every_package_and_the_packages_own_wins() -> None:
    block = """\
scheduler: {policies: {latency_budget: 30ms, qos_class: sensor_data}}
components: {base_driver: {runsOn: Robot, scheduler: {policies: {qos_class: realtime}}}}"""
    driver, panel = spec(orchestration(block, TWO))["components"]
    assert (driver["qosClass"], driver["policies"], driver["runsOn"]) == (
        "realtime",
        {"latencyBudget": "30ms"},
        "Robot",
    )
    assert (panel["qosClass"], panel["policies"]) == ("sensor_data", {"latencyBudget": "30ms"})


def test_the_words_of_robotapp_are_taken_as_they_are_with_templates() -> None:
    block = """\
robotapp: {robots: {selector: {matchLabels: {robotics.io/robot: '{{ robot }}'}}}, dds: {pool: lab}}
components: {base-driver: {replicas: 2, resources: {requests: {cpu: 100m}}}}"""
    found = spec("vars: {robot: amr-07}\n" + orchestration(block))
    assert found["robots"]["selector"]["matchLabels"] == {"robotics.io/robot": "amr-07"}
    assert found["dds"] == {"pool": "lab"}
    assert found["components"][0]["replicas"] == 2


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("schedulr: {}", "is not known here (did you mean scheduler?)"),
        ("scheduler: {polices: {}}", "is not known here (did you mean policies?)"),
        ("scheduler: {policies: {latency: 1ms}}", "scheduler.policies.latency: is not known here"),
        ("scheduler: {policies: {qos_class: realtme}}", "'realtme' is not allowed (did you mean realtime?)"),
        ("scheduler: {policies: {latency_budget: 30}}", "expected text, found a number (30); put it in quotes"),
        (
            "scheduler: {policies: {latency_budget: 30 ms}}",
            'spec.components[0].policies.latencyBudget "30 ms": write a number and a unit (us, ms, s, m or h), up to three times',
        ),
        ("scheduler: {policies: {queue_size: true}}", "expected a whole number, found true or false (true)"),
        ("scheduler: {policies: {tcp_nodelay: 1}}", "expected true or false, found a number (1)"),
        ("scheduler: {dds_domain: 300}", "'300' is not a DDS domain; allowed: auto, or a number from 0 to 232"),
        ("scheduler: {dds_domain: 150}", "domain 150 is outside 1-101 and 215-232"),
        ("scheduler: {dds_domain: 1, dds-domain: 2}", "says the same as"),
        (
            "scheduler: {affinity: {hardware_requirements: [{type: gpu, interface: x}]}}",
            "interface belongs to can, gpio, serial, usb",
        ),
        ("components: {nobody: {}}", "there is no package nobody"),
        (
            "components: {base_driver: {imag: x}}",
            "spec.components[0].imag is not a field of RobotApp (did you mean image?)",
        ),
        ("components: {base_driver: {name: x}}", "the component is named by its package"),
        ("components: {base_driver: {replicas: 0.5}}", "spec.components[0].replicas must be a whole number, found 0.5"),
        ("robotapp: {components: []}", "components are given under orchestration.components.<package>"),
        ("robotapp: {update: {policy: Sometimes}}", '"Sometimes" is not allowed; allowed: Automatic, OnDemand'),
        ("robotapp: {dds: {domain: -1}}", "spec.dds.domain must be at least 0, found -1"),
        ("name: '!!'", "has no letter or digit to make a name of"),
        (f"name: {'x' * 41}", "is longer than 40 characters"),
    ],
)
def test_what_is_wrong_in_the_block_is_said_with_its_line(block: str, message: str) -> None:
    text = refusal(orchestration(block))
    assert message in text
    assert text.startswith("Rigelfile:10: ")


def test_our_words_win_over_the_scheduler_block() -> None:
    block = "{scheduler: {name: a, topology: {preferred_zones: [x]}}, robotapp: {schedulerName: b, placement: {objective: Balance}}}"
    found = spec(orchestration(block))
    assert (found["schedulerName"], found["placement"]) == ("b", {"zones": ["x"], "objective": "Balance"})


@pytest.mark.parametrize("value", ["{}", "null"])
def test_an_empty_block_of_our_words_says_nothing(value: str) -> None:
    assert spec(orchestration(f"robotapp: {value}")) == spec(ONE)


def test_a_device_of_several_packages_has_no_owner() -> None:
    text = refusal(orchestration("scheduler: {affinity: {hardware_requirements: [{type: usb}]}}", TWO))
    assert "a usb device belongs to one component" in text


def test_one_image_for_several_packages_is_refused() -> None:
    assert "is one image, but there are several packages" in refusal(orchestration("application_image: x", TWO))
    assert component("application_image: acme/all:2")["image"] == "acme/all:2"


def test_an_app_without_any_distro_is_refused() -> None:
    text = "packages: [{package: a, image: i, dockerfile: d}]\n"
    assert "no package names its ROS distro" in refusal(text)
    assert spec(orchestration("robotapp: {ros: {distro: jazzy}}", text))["ros"] == {"distro": "jazzy"}


def test_settings_of_other_plugins_are_noted_as_left_out() -> None:
    assert rendered(orchestration("rolling_update: {max_surge: 1}")).notes == (
        "Rigelfile:10: deploy[0].kwargs.orchestration.rolling_update is not carried over",
    )


class TestRos1:
    NOETIC = ONE.replace("humble", "noetic")

    def test_the_master_is_managed_unless_told_otherwise(self) -> None:
        assert "ros1" not in spec(orchestration("deploy_ros_master: true", self.NOETIC))
        block = "{deploy_ros_master: false, robotapp: {ros1: {uri: 'http://master:11311'}}}"
        assert spec(orchestration(block, self.NOETIC))["ros1"] == {"master": "External", "uri": "http://master:11311"}

    def test_its_image_is_carried_over(self) -> None:
        assert spec(orchestration("ros_master_image: ros:noetic", self.NOETIC))["ros1"] == {"image": "ros:noetic"}

    def test_a_master_for_ros_2_is_noted(self) -> None:
        (note,) = rendered(orchestration("deploy_ros_master: true")).notes
        assert "has no meaning for ROS 2 (humble)" in note


def test_the_name_comes_from_the_flag_then_the_file_then_the_folder() -> None:
    text = orchestration("{name: in_file, namespace: fleet}")
    assert rendered(text).app["metadata"] == {"name": "in-file", "namespace": "fleet"}
    assert rendered(text, name="flag", override=True, namespace="other").app["metadata"] == {
        "name": "flag",
        "namespace": "other",
    }
    assert rendered(ONE, name="My Folder").app["metadata"] == {"name": "my-folder"}


WORDS = st.text(alphabet="az-_ {}1", max_size=5)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from(["name", "scheduler", "components", "robotapp", "namespace"]), ANYTHING))
def test_any_block_gives_an_app_or_one_error(block: dict[str, object]) -> None:
    with suppress(BridgeError):
        assert rendered(orchestration(json.dumps(block))).app["kind"] == "RobotApp"
