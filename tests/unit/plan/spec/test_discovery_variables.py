"""What lint and `Accepted` name as lost where a component's own variables meet those of the operator's discovery."""

from typing import Any

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.discovery_variables import variable_notes
from robotapp_operator.plan.spec.validate import notes_of

CYCLONE = {"rmw": "rmw_cyclonedds_cpp"}
ZENOH = {"rmw": "rmw_zenoh_cpp"}
PEERS = {"discovery": {"mode": "Peers"}}


def notes(name: str, value: str | None, *, distro: str = "humble", **ros2: Any) -> list[str]:
    source = {"valueFrom": {"configMapKeyRef": {"name": "site", "key": "k"}}} if value is None else {"value": value}
    fields = {"ros2": ros2} if ros2 else {}
    app = make_app(component("a", env=[{"name": name, **source}]), component("b"), ros={"distro": distro}, **fields)
    return [str(note) for note in variable_notes(app.spec)]


@pytest.mark.parametrize(
    ("name", "value", "distro", "ros2", "lost"),
    [
        ("ROS_LOCALHOST_ONLY", "1", "humble", CYCLONE, '"1" keeps it inside its pod'),
        ("ROS_LOCALHOST_ONLY", "1", "humble", {}, '"1" keeps it inside its pod'),
        ("ROS_LOCALHOST_ONLY", "1", "jazzy", {}, "has no effect on clients of a discovery server"),
        ("ROS_LOCALHOST_ONLY", "1", "jazzy", PEERS, "ROS_STATIC_PEERS are ignored"),
        ("ROS_LOCALHOST_ONLY", None, "humble", {}, "a value that means this pod alone"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "jazzy", {}, '"OFF" keeps it inside its pod'),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "jazzy", CYCLONE, '"LOCALHOST" keeps it inside its pod'),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "local", "jazzy", CYCLONE, '"local" counts as LOCALHOST'),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT", "jazzy", PEERS, "ROS_STATIC_PEERS are ignored"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "humble", {}, "does not know it"),
        ("ROS_DISCOVERY_SERVER", "site:11811", "humble", {}, "replaces the operator's two servers"),
        ("FASTDDS_BUILTIN_TRANSPORTS", "SHM", "jazzy", {}, "reaches no other pod"),
        ("FASTDDS_BUILTIN_TRANSPORTS", "LARGE_DATA", "jazzy", {}, "does not reach the operator's discovery servers"),
        ("FASTDDS_BUILTIN_TRANSPORTS", "DEFAULT", "jazzy", {"transport": "UDP"}, "replaces spec.ros2.transport: UDP"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/p.xml", "humble", {}, "leave discovery out of the file"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", None, "kilted", {}, "leave discovery out of the file"),
        ("FASTDDS_ENVIRONMENT_FILE", "/e.json", "jazzy", {}, "the operator's variables count"),
        ("CYCLONEDDS_URI", "<CycloneDDS><Domain><General><AllowMulticast>true</AllowMulticast></General></Domain></CycloneDDS>",
         "humble", CYCLONE, "AllowMulticast true replaces the operator's false"),
        ("CYCLONEDDS_URI", '<CycloneDDS><Domain id="0"/></CycloneDDS>', "humble", CYCLONE, "it is for domain 0 alone"),
        ("ZENOH_CONFIG_OVERRIDE", 'mode="peer"', "jazzy", ZENOH, "mode replaces the operator's"),
        ("ZENOH_SESSION_CONFIG_URI", "/z.json5", "jazzy", ZENOH, "mode and connect/endpoints"),
        ("ROS_HOSTNAME", "amr-07", "noetic", {}, "every other pod must resolve it"),
        ("ROS_IP", "10.0.0.1", "noetic", {}, "every other pod reaches it"),
    ],
)  # fmt: skip
def test_a_note_names_the_variable_the_component_and_what_is_lost(
    name: str, value: str | None, distro: str, ros2: dict[str, Any], lost: str
) -> None:
    (note,) = notes(name, value, distro=distro, **ros2)
    assert note.startswith(f"spec.components[0].env: {name} of a: ")
    assert lost in note


@pytest.mark.parametrize(
    ("name", "value", "distro", "ros2"),
    [
        ("ROS_LOCALHOST_ONLY", "0", "humble", {}),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET", "jazzy", {}),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "jazzy", PEERS),
        ("ROS_LOCALHOST_ONLY", "1", "humble", {"discovery": {"mode": "Localhost"}}),
        ("CYCLONEDDS_URI", "file:///etc/cyclone.xml", "humble", CYCLONE),
        ("CYCLONEDDS_URI", None, "humble", CYCLONE),
        ("CYCLONEDDS_URI", "<CycloneDDS/>", "humble", {}),
        ("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=true", "jazzy", ZENOH),
        ("ROS_STATIC_PEERS", "10.0.0.1", "jazzy", PEERS),
        ("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4", "jazzy", {}),
        ("RCUTILS_COLORIZED_OUTPUT", "1", "humble", {}),
    ],
)
def test_what_loses_nothing_gets_no_note(name: str, value: str | None, distro: str, ros2: dict[str, Any]) -> None:
    assert notes(name, value, distro=distro, **ros2) == []


def test_an_app_of_one_pod_loses_nothing_by_staying_alone() -> None:
    app = make_app(component("a", env=[{"name": "ROS_LOCALHOST_ONLY", "value": "1"}]))
    assert list(variable_notes(app.spec)) == []


def test_env_from_names_the_variables_of_which_the_operators_value_counts() -> None:
    source = {"configMapRef": {"name": "site"}}
    app = make_app(component("a", envFrom=[source]), component("b"), ros2=CYCLONE)
    (note,) = (str(note) for note in variable_notes(app.spec))
    assert note.startswith("spec.components[0].envFrom: of the keys ROS_DOMAIN_ID, RMW_IMPLEMENTATION, CYCLONEDDS_URI")
    assert "write env with valueFrom" in note


def test_init_containers_and_sidecars_are_looked_at_as_well() -> None:
    sidecar = {
        "name": "rec",
        "image": "rec:1",
        "restartPolicy": "Always",
        "env": [{"name": "ROS_LOCALHOST_ONLY", "value": "1"}],
    }
    app = make_app(component("a", template={"spec": {"initContainers": [sidecar]}}), component("b"))
    (note,) = (str(note) for note in variable_notes(app.spec))
    assert note.startswith("spec.components[0].template.spec.initContainers[0].env: ROS_LOCALHOST_ONLY of rec")


def test_an_optional_value_that_is_not_joined_is_named() -> None:
    source = {"configMapKeyRef": {"name": "site", "key": "k", "optional": True}}
    app = make_app(component("a", env=[{"name": "CYCLONEDDS_URI", "valueFrom": source}]), component("b"), ros2=CYCLONE)
    (note,) = (str(note) for note in variable_notes(app.spec))
    assert "leave optional out" in note


def test_accepted_has_the_notes_too() -> None:
    app = make_app(component("a", env=[{"name": "ROS_DISCOVERY_SERVER", "value": "site:11811"}]), component("b"))
    assert any("ROS_DISCOVERY_SERVER of a" in note for note in notes_of(app))


def test_a_micro_ros_agent_is_told_its_domain() -> None:
    agent = component("agent", image="microros/micro-ros-agent:humble")
    (note,) = (str(note) for note in variable_notes(make_app(agent, component("base")).spec))
    assert 'write {name: XRCE_DOMAIN_ID_OVERRIDE, value: "$(ROS_DOMAIN_ID)"}' in note
    told = component(
        "agent",
        image="microros/micro-ros-agent:humble",
        env=[{"name": "XRCE_DOMAIN_ID_OVERRIDE", "value": "$(ROS_DOMAIN_ID)"}],
    )
    assert list(variable_notes(make_app(told, component("base")).spec)) == []
