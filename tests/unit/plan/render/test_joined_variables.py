"""Variables of discovery that both the operator and a component write."""

from typing import Any
from xml.etree import ElementTree as ET

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.discovery_variables import discovery_variables
from robotapp_operator.plan.render.environment import ros2_environment
from robotapp_operator.plan.render.parameters import NONE
from robotapp_operator.plan.render.pod_template import container, pod_template
from robotapp_operator.plan.spec.desired import App, Domain, desired_of

OWN_XML = '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="eth0"/></Interfaces></General></Domain></CycloneDDS>'
CYCLONE = {"ros2": {"rmw": "rmw_cyclonedds_cpp"}}
ZENOH = {"ros2": {"rmw": "rmw_zenoh_cpp"}}


def app_with(*variables: dict[str, Any], distro: str = "humble", **spec: Any) -> App:
    return make_app(component("drive", env=list(variables)), component("plan"), ros={"distro": distro}, **spec)


def environment_of(app: App, name: str = "drive") -> list[dict[str, Any]]:
    part = next(one for one in app.spec.components if one.name == name)
    return container(part, desired_of(app, ""), domain=Domain(7), state=NONE)["env"]


def value_of(app: App, variable: str, name: str = "drive") -> str:
    values = [one["value"] for one in environment_of(app, name) if one["name"] == variable]
    assert len(values) == 1
    return str(values[0])


def test_an_own_cyclone_configuration_comes_after_the_operators_so_that_both_count() -> None:
    app = app_with({"name": "CYCLONEDDS_URI", "value": OWN_XML}, **CYCLONE)
    ours, own = value_of(app, "CYCLONEDDS_URI").split(",")
    assert own == OWN_XML
    assert ours == value_of(app, "CYCLONEDDS_URI", "plan")
    assert len(list(ET.fromstring(ours).iter("Peer"))) == 2  # noqa: S314 - our own text


def test_a_component_that_refers_to_the_operators_value_chooses_its_place() -> None:
    app = app_with({"name": "CYCLONEDDS_URI", "value": f"{OWN_XML},$(CYCLONEDDS_URI)"}, **CYCLONE)
    assert value_of(app, "CYCLONEDDS_URI") == f"{OWN_XML},{value_of(app, 'CYCLONEDDS_URI', 'plan')}"


def test_a_value_from_a_config_map_is_joined_by_reference() -> None:
    source = {"configMapKeyRef": {"name": "site", "key": "cyclone"}}
    app = app_with({"name": "CYCLONEDDS_URI", "valueFrom": source}, **CYCLONE)
    kept = [one for one in environment_of(app) if one["name"] == "ROBOTAPP_OWN_CYCLONEDDS_URI"]
    assert kept == [{"name": "ROBOTAPP_OWN_CYCLONEDDS_URI", "valueFrom": source}]
    assert value_of(app, "CYCLONEDDS_URI").endswith(",$(ROBOTAPP_OWN_CYCLONEDDS_URI)")


def test_an_optional_value_replaces_the_operators_because_its_reference_might_stay_as_it_is() -> None:
    source = {"configMapKeyRef": {"name": "site", "key": "cyclone", "optional": True}}
    app = app_with({"name": "CYCLONEDDS_URI", "valueFrom": source}, **CYCLONE)
    assert [one for one in environment_of(app) if "CYCLONEDDS" in one["name"]] == [
        {"name": "CYCLONEDDS_URI", "valueFrom": source}
    ]


@pytest.mark.parametrize("own", ["", ";"])
def test_an_empty_own_value_leaves_the_operators(own: str) -> None:
    app = app_with({"name": "ZENOH_CONFIG_OVERRIDE", "value": own}, **ZENOH)
    assert value_of(app, "ZENOH_CONFIG_OVERRIDE") == value_of(app, "ZENOH_CONFIG_OVERRIDE", "plan")


def test_zenoh_reads_both_overrides_and_the_own_one_last() -> None:
    app = app_with({"name": "ZENOH_CONFIG_OVERRIDE", "value": "transport/shared_memory/enabled=true"}, **ZENOH)
    parts = value_of(app, "ZENOH_CONFIG_OVERRIDE").split(";")
    assert parts[0] == 'mode="client"'
    assert parts[-1] == "transport/shared_memory/enabled=true"


@pytest.mark.parametrize(
    ("rmw", "variable", "own", "separator"),
    [
        ("rmw_fastrtps_cpp", "ROS_STATIC_PEERS", "10.0.0.9", ";"),
        ("rmw_connextdds", "NDDS_DISCOVERY_PEERS", "udpv4://10.0.0.9", ","),
    ],
)
def test_lists_of_peers_are_joined(rmw: str, variable: str, own: str, separator: str) -> None:
    peers = {"ros2": {"rmw": rmw, "discovery": {"mode": "Peers"}}}
    app = app_with({"name": variable, "value": own}, distro="jazzy", **peers)
    assert len(value_of(app, variable).split(separator)) == 3
    assert value_of(app, variable).endswith(separator + own)


def test_servers_of_its_own_replace_the_operators() -> None:
    """Fast DDS takes the place in the list for the server's id, so a joined list would name wrong ones."""
    app = app_with({"name": "ROS_DISCOVERY_SERVER", "value": "site:11811"})
    assert value_of(app, "ROS_DISCOVERY_SERVER") == "site:11811"


def test_a_joinable_variable_that_the_operator_does_not_write_stays_as_it_is() -> None:
    app = app_with({"name": "CYCLONEDDS_URI", "value": OWN_XML})
    assert value_of(app, "CYCLONEDDS_URI") == OWN_XML


@pytest.mark.parametrize(
    "rmw", ["rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "rmw_zenoh_cpp", "rmw_connextdds", "rmw_gurumdds_cpp"]
)
@pytest.mark.parametrize("mode", ["Auto", "Server", "Peers", "Router", "Multicast", "Localhost"])
@pytest.mark.parametrize("distro", ["humble", "jazzy"])
@pytest.mark.parametrize("transport", ["Auto", "UDP"])
def test_the_checks_know_the_variables_that_are_rendered(rmw: str, mode: str, distro: str, transport: str) -> None:
    ros2 = {"rmw": rmw, "discovery": {"mode": mode}, "transport": transport}
    app = make_app(component("a"), component("b"), ros={"distro": distro}, ros2=ros2)
    rendered = {variable.name for variable in ros2_environment(desired_of(app, ""), domain=7)}
    assert rendered - {"ROS_DOMAIN_ID", "RMW_IMPLEMENTATION"} == discovery_variables(app.spec)


def steps_of(app: App) -> list[dict[str, Any]]:
    template = pod_template(app.spec.components[0], desired_of(app, "amr-07"), domain=Domain(7), state=NONE)
    steps: list[dict[str, Any]] = template["spec"]["initContainers"]
    return [step for step in steps if step["name"] in ("rec", "first")]


def test_sidecars_and_init_containers_are_in_the_domain_of_their_component() -> None:
    steps = [
        {"name": "first", "image": "a"},
        {"name": "rec", "image": "b", "restartPolicy": "Always", "env": [{"name": "A", "value": "$(ROS_DOMAIN_ID)"}]},
    ]
    app = make_app(component("drive", template={"spec": {"initContainers": steps}}), component("plan"))
    main = {one["name"]: one.get("value") for one in environment_of(app)}
    for step in steps_of(app):
        variables = {one["name"]: one.get("value") for one in step["env"]}
        assert variables["ROS_DOMAIN_ID"] == "7"
        assert variables["ROS_DISCOVERY_SERVER"].count("discovery-") == main["ROS_DISCOVERY_SERVER"].count("discovery-")
        assert variables["RMW_IMPLEMENTATION"] == main["RMW_IMPLEMENTATION"]
    assert steps_of(app)[1]["env"][-1] == {"name": "A", "value": "$(ROS_DOMAIN_ID)"}, "after what it refers to"


def test_a_sidecars_own_settings_are_joined_as_a_components_are() -> None:
    step = {"name": "rec", "image": "b", "env": [{"name": "CYCLONEDDS_URI", "value": OWN_XML}]}
    app = make_app(component("drive", template={"spec": {"initContainers": [step]}}), component("plan"), **CYCLONE)
    (value,) = [one["value"] for one in steps_of(app)[0]["env"] if one["name"] == "CYCLONEDDS_URI"]
    assert value.startswith("<CycloneDDS>")
    assert value.endswith(OWN_XML)


def test_a_sidecar_of_ros_1_finds_the_master_by_the_pods_own_address() -> None:
    step = {"name": "rec", "image": "b"}
    app = make_app(component("drive", template={"spec": {"initContainers": [step]}}), ros={"distro": "noetic"})
    assert {"ROS_MASTER_URI", "ROS_IP"} <= {one["name"] for one in steps_of(app)[0]["env"]}
