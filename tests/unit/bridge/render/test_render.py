"""The orchestration block: every field of the scheduler block, our own words, what is refused."""

import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.rigel.rigelfiles import ONE, TWO, orchestration, refusal, rendered, spec

from rigel_bridge.document.failures import BridgeError


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
        "scheduler: {affinity: {hardware_requirements: [{type: can, interface: can0}, {type: can}, {type: usb, model: cam}, {type: gpu, model: nvidia}, {type: lidar, interface: eth1}, {type: gpu, model: nvidia}]}}"
    )
    assert found["devices"] == [
        {"name": "can", "type": "can", "interface": "can0"},
        {"name": "can-2", "type": "can"},
        {"name": "usb", "type": "usb", "model": "cam"},
    ]
    assert found["requires"] == [{"type": "gpu", "model": "nvidia"}, {"type": "lidar", "interface": "eth1"}]


def test_peers_inside_the_app_are_told_from_foreign_ones() -> None:
    block = "components: {operator_ui: {scheduler: {shared_data: {peer_pods: [base_driver, mapper], pvc: [map-pvc]}}}}"
    found = spec(orchestration(block, TWO))["components"][1]
    assert found["sharedData"] == {"with": ["base-driver"], "peerPods": ["mapper"], "claimNames": ["map-pvc"]}


@pytest.mark.parametrize("package", ["base_driver", "Base_Driver", "base__driver", "base.driver_"])
def test_every_place_that_names_a_package_finds_its_component(package: str) -> None:
    packages = TWO.replace("package: base_driver", f"package: {package}")
    block = f"components: {{{package}: {{replicas: 2}}, operator_ui: {{scheduler: {{shared_data: {{peer_pods: [{package}]}}}}}}}}"
    driver, panel = spec(orchestration(block, packages))["components"]
    assert (driver["name"], driver["replicas"]) == ("base-driver", 2)
    assert panel["sharedData"] == {"with": ["base-driver"]}


@pytest.mark.parametrize("key", ["shared_data", "shared-data"])
def test_shared_data_in_both_spellings(key: str) -> None:
    assert component(f"scheduler: {{{key}: {{pvc: [p]}}}}")["sharedData"] == {"claimNames": ["p"]}


@pytest.mark.parametrize(("text", "domain"), [("auto", None), ("7", 7), ('"12"', 12), ("215", 215)])
def test_the_domain_is_allocated_or_asked_for(text: str, domain: int | None) -> None:
    assert spec(orchestration(f"scheduler: {{dds_domain: {text}}}")).get("ros2", {}).get("domain") == domain


def test_the_common_block_holds_for_every_package_and_the_packages_own_wins() -> None:
    block = """\
scheduler: {policies: {latency_budget: 30ms, qos_class: sensor_data}}
components: {base_driver: {runsOn: [Robot], scheduler: {policies: {qos_class: realtime}}}}"""
    driver, panel = spec(orchestration(block, TWO))["components"]
    assert (driver["qosClass"], driver["policies"], driver["runsOn"]) == (
        "realtime",
        {"latencyBudget": "30ms"},
        ["Robot"],
    )
    assert (panel["qosClass"], panel["policies"]) == ("sensor_data", {"latencyBudget": "30ms"})


def test_the_words_of_robotapp_are_taken_as_they_are_with_templates() -> None:
    block = """\
robotapp: {robots: {nodeSelector: {matchLabels: {robotics.io/robot: '{{ robot }}'}}}, ros2: {pool: lab}}
components: {base-driver: {replicas: 2, resources: {requests: {cpu: 100m}}}}"""
    found = spec("vars: {robot: amr-07}\n" + orchestration(block))
    assert found["robots"]["nodeSelector"]["matchLabels"] == {"robotics.io/robot": "amr-07"}
    assert found["ros2"] == {"pool": "lab"}
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
        ("scheduler: {dds_domain: 1, dds-domain: 2}", "means the same as"),
        ("components: {nobody: {}}", "there is no package nobody"),
        (
            "components: {base_driver: {imag: x}}",
            "spec.components[0].imag is not a field of RobotApp (did you mean image?)",
        ),
        ("components: {base_driver: {runsOn: Robot}}", 'spec.components[0].runsOn must be a list, found "Robot"'),
        (
            "components: {base_driver: {template: {spec: {nodeName: n}}}}",
            "nodeName cannot be set in the template; write nodeSelector",
        ),
        (
            "components: {base_driver: {template: {spec: {resourceClaims: [{name: a}]}}}}",
            "write devices of the component",
        ),
        ("components: {base_driver: {tolerations: []}}", "spec.components[0].tolerations is not a field of RobotApp"),
        ("robotapp: {dds: {domain: 7}}", "spec.dds is not a field of RobotApp"),
        ("components: {base_driver: {name: x}}", "the component is named by its package"),
        ("components: {base_driver: {replicas: 0.5}}", "spec.components[0].replicas must be a whole number, found 0.5"),
        ("robotapp: {components: []}", "components are given under orchestration.components.<package>"),
        ("robotapp: {update: {operator: Sometimes}}", '"Sometimes" is not allowed; allowed: Automatic, OnDemand'),
        ("robotapp: {ros2: {domain: -1}}", "spec.ros2.domain must be at least 0, found -1"),
        ("name: '!!'", "has no letter or digit to make a name of"),
        (f"name: {'x' * 41}", "is longer than 40 characters"),
    ],
)
def test_what_is_wrong_in_the_block_is_said_with_its_line(block: str, message: str) -> None:
    text = refusal(orchestration(block))
    assert message in text
    assert text.startswith("Rigelfile:10: ")


def test_what_the_block_has_no_word_for_is_said_in_robotapps_words() -> None:
    block = """\
components:
  base_driver:
    runsOn: [Edge, Robot]
    devices: [{name: cam, type: usb, usbID: '8086:0b3a', sharing: Namespace}]
    template: {spec: {priorityClassName: high, terminationGracePeriodSeconds: 5}}
    readinessProbe: {exec: {command: [ready]}}
    parameters: [{inline: '/**: {ros__parameters: {v: 1.0}}'}, {configMapKeyRef: {name: drv, key: $(ROBOTAPP_ROBOT).yaml, optional: true}}]
robotapp: {placement: {gang: None}, edges: [{topic: /odom, from: base-driver, to: '@robot', rateHz: 500m}]}"""
    found = spec(orchestration(block))
    driver = found["components"][0]
    assert driver["runsOn"] == ["Edge", "Robot"]
    assert driver["devices"] == [{"name": "cam", "type": "usb", "usbID": "8086:0b3a", "sharing": "Namespace"}]
    assert driver["template"]["spec"] == {"priorityClassName": "high", "terminationGracePeriodSeconds": 5}
    assert driver["readinessProbe"] == {"exec": {"command": ["ready"]}}
    assert driver["parameters"][1]["configMapKeyRef"]["key"] == "$(ROBOTAPP_ROBOT).yaml"
    assert (found["placement"], found["edges"][0]["rateHz"]) == ({"gang": "None"}, "500m")


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


def test_settings_without_a_place_are_noted_as_left_out() -> None:
    (note,) = rendered(orchestration("rolling_update: {max_surge: 1}")).notes
    assert note.startswith(
        "Rigelfile:10: deploy[0].kwargs.orchestration.rolling_update is not carried over: a RobotApp replaces a pod"
    )


def test_a_command_of_the_block_does_not_take_the_packages_as_arguments() -> None:
    assert "args" not in component("components: {base_driver: {command: [run]}}")
    assert component("components: {base_driver: {command: [run], args: [a]}}")["args"] == ["a"]


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("robotapp: {edges: [{topic: /a, from: base-drivr, to: '@robot'}]}", "spec.edges[0].from 'base-drivr' is no component (did you mean base-driver?); components: base-driver, @robot"),
        ("components: {base_driver: {colocateWith: [ui]}}", "spec.components[0].colocateWith[0] 'ui' is no component; components: base-driver"),
    ],
)  # fmt: skip
def test_a_name_that_is_no_component_is_told_with_its_line(block: str, message: str) -> None:
    found = refusal(orchestration(block))
    assert found == f"Rigelfile:10: {message}"


class TestRos1:
    NOETIC = ONE.replace("humble", "noetic")

    def test_the_master_is_managed_unless_told_otherwise(self) -> None:
        assert "ros1" not in spec(orchestration("deploy_ros_master: true", self.NOETIC))
        block = "{deploy_ros_master: false, robotapp: {ros1: {uri: 'http://master:11311'}}}"
        assert spec(orchestration(block, self.NOETIC))["ros1"] == {"master": "External", "uri": "http://master:11311"}

    def test_its_image_is_carried_over(self) -> None:
        assert spec(orchestration("ros_master_image: ros:noetic", self.NOETIC))["ros1"] == {"image": "ros:noetic"}

    def test_a_master_that_rigels_plugin_would_run_is_left_to_the_operator(self) -> None:
        own = "    env: [{name: ROS_MASTER_URI, value: 'http://ros-master:11311'}, {name: ROS_IP, value: 10.0.0.1}, {name: A, value: b}]\n"
        found = rendered(self.NOETIC + own)
        assert found.app["spec"]["components"][0]["env"] == [{"name": "A", "value": "b"}]
        assert "ros1" not in found.app["spec"]
        assert found.notes == (
            "Rigelfile:2: env ROS_MASTER_URI is left out: the operator sets it",
            "Rigelfile:2: env ROS_IP is left out: the operator sets it",
        )

    def test_the_address_of_another_master_becomes_an_external_one(self) -> None:
        elsewhere = f"{self.NOETIC}    env: [{{name: ROS_MASTER_URI, value: 'http://robot:11311'}}]\n"
        found = spec(elsewhere)
        assert found["ros1"] == {"uri": "http://robot:11311", "master": "External"}
        assert "env" not in found["components"][0]
        assert "write deploy_ros_master: false" in refusal(orchestration("deploy_ros_master: true", elsewhere))
        twice = orchestration("robotapp: {ros1: {master: External, uri: 'http://other:11311'}}", elsewhere)
        assert "spec.ros1.uri is 'http://other:11311': keep one" in refusal(twice)

    def test_a_master_means_nothing_to_ros_2(self) -> None:
        found = rendered(ONE + "    env: [{name: ROS_MASTER_URI, value: 'http://robot:11311'}]\n")
        assert "env" not in found.app["spec"]["components"][0]
        assert found.notes == ("Rigelfile:2: env ROS_MASTER_URI is left out: ROS 2 does not read it",)

    def test_a_domain_is_a_setting_of_ros_2(self) -> None:
        text = refusal(orchestration("scheduler: {dds_domain: 7}", self.NOETIC))
        assert text == "Rigelfile:10: spec.ros2 has the settings of ROS 2, and noetic is ROS 1: remove them"

    def test_its_settings_are_refused_for_ros_2(self) -> None:
        text = refusal(orchestration("robotapp: {ros1: {image: 'ros:noetic'}}"))
        assert text == "Rigelfile:10: spec.ros1 has the settings of ROS 1, and humble is ROS 2: remove them"

    def test_a_distro_in_robotapps_words_decides_for_packages_that_name_none(self) -> None:
        text = "packages: [{package: a, image: i, dockerfile: d, env: [{name: ROS_DOMAIN_ID, value: 7}]}]\n"
        found = rendered(orchestration("{ros_master_image: 'ros:noetic', robotapp: {ros: {distro: noetic}}}", text))
        assert found.app["spec"]["ros1"] == {"image": "ros:noetic"}
        assert found.notes == ("Rigelfile:1: env ROS_DOMAIN_ID has no meaning for ROS 1 (noetic) and is left out",)

    def test_a_master_for_ros_2_is_noted(self) -> None:
        (note,) = rendered(orchestration("deploy_ros_master: true")).notes
        assert "has no meaning for ROS 2 (humble)" in note


def test_the_name_comes_from_the_flag_then_the_file_then_the_folder() -> None:
    text = orchestration("{name: in_file}")
    assert rendered(text).app["metadata"] == {"name": "in-file"}
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
