"""Workloads that met before a migration: one app, one domain, or a line that names whom they will not meet any more."""

from typing import Any

import pytest
from tests.unit.bridge.migration.test_migration import TELEOP, container, deployment, planned, spec

from rigel_bridge.migration.report import Plan, document, lines

TALKER, LISTENER = "acme/talker:humble-1", "acme/listener:humble-1"
CONFIG = {"kind": "ConfigMap", "metadata": {"name": "ros-env", "namespace": "fleet"}}


def node(name: str, image: str = TALKER, /, *, namespace: str = "fleet", **env: str) -> dict[str, Any]:
    """A Deployment with variables."""
    return node_with(name, image, namespace=namespace, env=[{"name": key, "value": text} for key, text in env.items()])


def node_with(name: str, image: str = TALKER, /, *, namespace: str = "fleet", **fields: Any) -> dict[str, Any]:
    made = deployment(name, TELEOP, container(image=image, **fields))
    made["metadata"]["namespace"] = namespace
    return made


def components(plan: Plan) -> list[list[str]]:
    return [[each["name"] for each in app.app["spec"]["components"]] for app in plan.apps]


def apart(plan: Plan) -> list[str]:
    assert not plan.refused
    return [line for app in plan.apps for line in app.apart]


@pytest.mark.parametrize(
    "env",
    [
        {},
        {"ROS_DOMAIN_ID": "0"},
        {"ROS_DOMAIN_ID": "7"},
        {"ROS_DISCOVERY_SERVER": "ds-0:11811;ds-1:11811"},
        {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp", "ZENOH_CONFIG_OVERRIDE": 'connect/endpoints=["tcp/router:7447"]'},
    ],
)
def test_talker_and_listener_of_one_graph_become_one_app(env: dict[str, str]) -> None:
    found = planned(node("talker", TALKER, **env), node("listener", LISTENER, **env))
    assert components(found) == [["talker", "listener"]]
    assert not apart(found)


def test_workloads_on_one_master_become_one_app() -> None:
    env = {"ROS_MASTER_URI": "http://ros-master:11311"}
    far = {"ROS_MASTER_URI": "http://ros-master.fleet.svc:11311"}
    app = spec(node("talker", "acme/x:noetic", **env), node("listener", "acme/y:noetic", **far))
    assert [each["name"] for each in app["components"]] == ["talker", "listener"]
    assert "ros1" not in app


@pytest.mark.parametrize(
    ("one", "two"),
    [
        ({"ROS_DOMAIN_ID": "7"}, {"ROS_DOMAIN_ID": "8"}),
        ({"ROS_DOMAIN_ID": "7"}, {}),
        ({"ROS_LOCALHOST_ONLY": "1"}, {}),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, {}),
        ({"ROS_DISCOVERY_SERVER": "a:11811"}, {"ROS_DISCOVERY_SERVER": "b:11811"}),
        ({"ROS_DISCOVERY_SERVER": "a:11811"}, {}),
        ({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}, {}),
    ],
)
def test_workloads_that_never_met_stay_apps_of_their_own(one: dict[str, str], two: dict[str, str]) -> None:
    found = planned(node("talker", TALKER, **one), node("listener", LISTENER, **two))
    assert components(found) == [["talker"], ["listener"]]
    assert not apart(found)


def test_a_domain_from_a_config_map_is_the_apps_domain() -> None:
    config = CONFIG | {"data": {"ROS_DOMAIN_ID": "42"}}
    listener = node_with("listener", LISTENER, envFrom=[{"configMapRef": {"name": "ros-env"}}])
    key = {"configMapKeyRef": {"name": "ros-env", "key": "ROS_DOMAIN_ID"}}
    talker = node_with("talker", env=[{"name": "ROS_DOMAIN_ID", "valueFrom": key}])
    third = node("third", TALKER, ROS_DOMAIN_ID="42")
    app = spec(config, talker, listener, third)
    assert app["ros2"] == {"domain": 42}
    assert [each["name"] for each in app["components"]] == ["talker", "listener", "third"]
    assert "env" not in app["components"][0]


def test_env_wins_over_env_from_and_a_later_source_over_an_earlier_one() -> None:
    first = CONFIG | {"data": {"DOMAIN_ID": "1"}}
    second = {"kind": "ConfigMap", "metadata": {"name": "b", "namespace": "fleet"}, "data": {"ROS_DOMAIN_ID": "2"}}
    sources = [{"prefix": "ROS_", "configMapRef": {"name": "ros-env"}}, {"configMapRef": {"name": "b"}}]
    assert spec(first, second, node_with("a", envFrom=sources))["ros2"] == {"domain": 2}
    assert spec(first, second, node_with("a", envFrom=sources[::-1]))["ros2"] == {"domain": 1}
    own = [{"name": "ROS_DOMAIN_ID", "value": "3"}]
    assert spec(first, second, node_with("a", envFrom=sources, env=own))["ros2"] == {"domain": 3}


def test_sources_that_are_not_read_are_named_and_keep_together_only_those_with_the_same_ones() -> None:
    sources = [{"secretRef": {"name": "fleet-secret"}}]
    found = planned(node_with("a", envFrom=sources), node_with("b", envFrom=sources), node("c"))
    assert components(found) == [["a", "b"], ["c"]]
    assert any("Secret fleet-secret is not read: if it states ROS_DOMAIN_ID" in note for note in found.apps[0].notes)
    (told,) = apart(found)
    assert told == (
        "deployment fleet/a and deployment fleet/c may have met: Secret fleet-secret may state the default domain; "
        "each app gets a domain of its own"
    )


def test_workloads_of_two_distributions_share_the_domain_and_the_report_names_discovery() -> None:
    found = planned(node("talker", TALKER, ROS_DOMAIN_ID="7"), node("listener", "acme/l:jazzy", ROS_DOMAIN_ID="7"))
    assert components(found) == [["talker"], ["listener"]]
    assert [app.app["spec"]["ros2"] for app in found.apps] == [{"domain": 7}, {"shareWith": [{"name": "talker"}]}]
    (told,) = apart(found)
    assert "discovery: {mode: Multicast}" in told
    assert f"  APART: {told}" in list(lines(found))
    assert document(found)["apps"][1]["apart"] == [told]


def test_workloads_of_two_distributions_go_on_with_their_discovery_servers() -> None:
    env = {"ROS_DISCOVERY_SERVER": "ds:11811"}
    found = planned(node("talker", TALKER, **env), node("listener", "acme/l:jazzy", **env))
    assert found.apps[1].app["spec"]["ros2"] == {"shareWith": [{"name": "talker"}]}
    assert [app.app["spec"]["components"][0]["env"][0]["value"] for app in found.apps] == ["ds:11811"] * 2
    assert not apart(found)


def test_servers_of_a_config_map_stay_those_of_the_component() -> None:
    """By envFrom the operator's own servers would count."""
    config = CONFIG | {"data": {"ROS_DISCOVERY_SERVER": "ds:11811"}}
    sources = [{"configMapRef": {"name": "ros-env"}}]
    app = spec(
        config, node_with("talker", envFrom=sources), node("listener", LISTENER, ROS_DISCOVERY_SERVER="ds:11811")
    )
    server = [{"name": "ROS_DISCOVERY_SERVER", "value": "ds:11811"}]
    assert [component["env"] for component in app["components"]] == [server, server]


def test_apps_of_two_namespaces_name_each_other_for_a_common_domain() -> None:
    found = planned(node("a", namespace="fleet", ROS_DOMAIN_ID="7"), node("b", namespace="lab", ROS_DOMAIN_ID="7"))
    assert [app.app["spec"]["ros2"] for app in found.apps] == [
        {"domain": 7, "shareWith": [{"name": "b", "namespace": "lab"}]},
        {"shareWith": [{"name": "a", "namespace": "fleet"}]},
    ]
    far = planned(node("a", namespace="fleet"), node("b", namespace="lab"))
    assert all("ros2" not in app.app["spec"] for app in far.apps), "no tenant shares the default domain on purpose"
    assert "each with a domain of its own" in apart(far)[0]


def test_apps_of_ros_1_that_cannot_be_one_keep_the_old_master() -> None:
    env = {"ROS_MASTER_URI": "http://ros-master:11311"}
    found = planned(node("talker", "acme/x:noetic", **env), node("listener", "acme/y:melodic", **env))
    uri = {"master": "External", "uri": "http://ros-master.fleet:11311"}
    assert [app.app["spec"]["ros1"] for app in found.apps] == [uri, uri]
    assert not apart(found)


def test_who_stays_is_named_by_the_app_that_met_it() -> None:
    web = deployment("web", {}, container(image="nginx:1"), schedulerName="default-scheduler")
    rviz = deployment("rviz", {}, container(image="ros:humble"), schedulerName="default-scheduler")
    bag = node("bag") | {"kind": "StatefulSet"}
    told = apart(planned(node("talker"), web, rviz, bag))
    assert [line.partition(" stays")[0] for line in told] == ["deployment fleet/rviz", "statefulset fleet/bag"]
    assert "migrate both in one call" in told[0]
    (one,) = apart(planned(node("talker"), node("listener"), names=["talker"]))
    assert one.startswith("deployment fleet/listener stays in the default domain")


def test_a_workload_that_is_refused_is_named_and_a_peer_of_it_goes_on() -> None:
    found = planned(node("talker"), node("listener", "acme/x:1"))
    assert components(found) == [["talker"]]
    assert "--distro" in found.refused[0]
    assert found.apps[0].apart[0].startswith("deployment fleet/listener stays in the default domain")


def test_who_asked_for_a_domain_of_its_own_gets_it_and_the_report_says_that_it_shared_one() -> None:
    alone = deployment("alone", {"dds-domain": "auto"}, container(image=TALKER))
    found = planned(alone, node("talker"))
    assert components(found) == [["alone"], ["talker"]]
    assert "each with a domain of its own" in apart(found)[0]


def test_peers_of_two_middlewares_are_not_forced_into_one_app() -> None:
    one = node("a", TALKER, RMW_IMPLEMENTATION="rmw_cyclonedds_cpp")
    two = deployment("b", {"shared-data": '{"peer_pods": ["a"]}'}, container(image=TALKER))
    found = planned(one, two)
    assert components(found) == [["a"], ["b"]]
    assert found.apps[0].app["spec"]["ros2"]["rmw"] == "rmw_cyclonedds_cpp"


def test_more_workloads_than_an_app_holds_share_a_domain() -> None:
    found = planned(*(node(f"n{index}", TALKER, ROS_DOMAIN_ID="9") for index in range(66)))
    assert [len(each) for each in components(found)] == [64, 2]
    assert found.apps[1].app["spec"]["ros2"] == {"shareWith": [{"name": "n0"}]}
