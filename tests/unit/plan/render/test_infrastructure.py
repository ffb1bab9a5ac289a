"""Discovery servers, router and roscore."""

from dataclasses import replace
from typing import Any

from tests.support.factories import make_app

from robotapp_api.model.names import SCHEDULING_GATE, Label
from robotapp_operator.plan.render.child import DEPLOYMENT, SERVICE, Child
from robotapp_operator.plan.render.infrastructure import infrastructure
from robotapp_operator.plan.render.services import peers_service
from robotapp_operator.plan.spec.desired import LONGEST_SERVER_NAME, HelperDefaults, desired_of


def parts(robot: str = "", **spec: Any) -> list[Child]:
    return infrastructure(desired_of(make_app(**spec), robot), running=True)


def pod_spec(child: Child) -> dict[str, Any]:
    spec: dict[str, Any] = child.spec["template"]["spec"]
    return spec


def deployments(children: list[Child]) -> list[Child]:
    return [child for child in children if child.ref.kind == DEPLOYMENT]


def services(children: list[Child]) -> list[Child]:
    return [child for child in children if child.ref.kind == SERVICE]


def test_fast_dds_has_two_servers_with_a_name_each_under_one_service() -> None:
    found = parts()
    (service,) = services(found)
    assert service.spec["clusterIP"] == "None"
    assert service.spec["publishNotReadyAddresses"] is True
    assert len(deployments(found)) == 2
    names = []
    for index, server in enumerate(deployments(found)):
        assert pod_spec(server)["containers"][0]["args"] == ["fastdds", "discovery", "-i", str(index), "-p", "11811"]
        assert service.spec["selector"].items() <= server.spec["template"]["metadata"]["labels"].items()
        assert pod_spec(server)["subdomain"] == service.ref.name
        names.append(f"{pod_spec(server)['hostname']}.{service.ref.name}")
    assert tuple(names) == desired_of(make_app(), "").server_names


def test_the_service_of_the_servers_selects_no_component() -> None:
    (service,) = services(parts(robot="amr-07"))
    assert service.spec["selector"] == {
        "robotics.io/app": "teleop",
        "robotics.io/instance": "amr-07",
        "robotics.io/role": "discovery",
    }


def test_names_of_servers_are_short_enough_for_fast_dds() -> None:
    desired = desired_of(make_app(name="a" * 40), "robot-" + "r" * 57)
    assert max(len(name) for name in desired.server_names) == LONGEST_SERVER_NAME
    assert len({*desired.server_names}) == 2


def test_servers_avoid_each_other_and_the_first_stays_with_the_robot() -> None:
    first, second = deployments(parts(robot="amr-07"))
    for server in (first, second):
        assert "podAntiAffinity" in pod_spec(server)["affinity"]
    (preference,) = pod_spec(first)["affinity"]["nodeAffinity"]["preferredDuringSchedulingIgnoredDuringExecution"]
    assert preference["preference"]["matchExpressions"][0]["values"] == ["amr-07"]
    assert "preferredDuringSchedulingIgnoredDuringExecution" not in pod_spec(second)["affinity"]["nodeAffinity"]
    assert "tolerations" in pod_spec(first)


def test_servers_go_where_every_component_may_go() -> None:
    taint = {"key": "pool", "operator": "Equal", "value": "robotics", "effect": "NoSchedule"}
    own = {"key": "gpu", "operator": "Exists"}
    components = [
        {
            "name": "sense",
            "image": "a:1",
            "template": {"spec": {"tolerations": [taint], "nodeSelector": {"pool": "robotics", "disk": "ssd"}}},
        },
        {
            "name": "plan",
            "image": "a:1",
            "template": {"spec": {"tolerations": [own, taint], "nodeSelector": {"pool": "robotics"}}},
        },
    ]
    for server in deployments(parts(components=components)):
        assert pod_spec(server)["tolerations"] == [taint]
        assert pod_spec(server)["nodeSelector"] == {"pool": "robotics"}
    for server in deployments(parts()):
        assert "tolerations" not in pod_spec(server)
        assert "nodeSelector" not in pod_spec(server)


def test_infrastructure_for_another_scheduler_is_gated_as_its_components_are() -> None:
    for spec in ({}, {"ros2": {"rmw": "rmw_zenoh_cpp"}}, {"ros": {"distro": "noetic"}}):
        for child in deployments(parts(schedulerName="default-scheduler", **spec)):
            assert pod_spec(child)["schedulingGates"] == [{"name": SCHEDULING_GATE}]
        assert all("schedulingGates" not in pod_spec(child) for child in deployments(parts(**spec)))


def test_infrastructure_has_a_role_and_no_component_and_no_domain() -> None:
    for spec in ({}, {"ros2": {"rmw": "rmw_zenoh_cpp"}}, {"ros": {"distro": "noetic"}}):
        for child in deployments(parts(**spec)):
            labels = child.spec["template"]["metadata"]["labels"]
            assert Label.ROLE in labels
            assert Label.COMPONENT not in labels
            env = pod_spec(child)["containers"][0].get("env", [])
            assert "ROS_DOMAIN_ID" not in {variable["name"] for variable in env}


def test_images_follow_the_distribution_unless_written() -> None:
    assert pod_spec(parts(ros={"distro": "jazzy"})[0])["containers"][0]["image"] == "ros:jazzy-ros-base"
    assert pod_spec(parts(ros2={"discovery": {"image": "own"}})[0])["containers"][0]["image"] == "own"
    assert pod_spec(parts(ros={"distro": "noetic"}, ros1={"image": "own"})[0])["containers"][0]["image"] == "own"


def test_the_zenoh_router_comes_from_the_first_component_and_listens_on_ipv4_and_ipv6() -> None:
    deployment, service = parts(ros2={"rmw": "rmw_zenoh_cpp"})
    container = pod_spec(deployment)["containers"][0]
    assert container["image"] == "reg/operator:1"
    listen, on_failure = container["env"][0]["value"].split(";")
    assert listen == 'listen/endpoints=["tcp/[::]:7447","tcp/0.0.0.0:7447"]'
    assert on_failure == "listen/exit_on_failure=false", "one of the two fails where [::] serves both, or is not there"
    assert service.spec["ports"][0]["port"] == 7447
    assert "clusterIP" not in service.spec


def test_a_managed_master_answers_on_its_port_and_may_be_pinned_to_a_node() -> None:
    deployment, service = parts(ros={"distro": "noetic"}, placement={"masterNode": "edge-1"})
    assert pod_spec(deployment)["containers"][0]["readinessProbe"] == {"tcpSocket": {"port": 11311}, "periodSeconds": 2}
    required = pod_spec(deployment)["affinity"]["nodeAffinity"]["requiredDuringSchedulingIgnoredDuringExecution"]
    assert required["nodeSelectorTerms"] == [
        {"matchFields": [{"key": "metadata.name", "operator": "In", "values": ["edge-1"]}]}
    ]
    assert service.spec["ports"][0]["port"] == 11311


def test_external_masters_cyclone_and_multicast_need_nothing() -> None:
    assert parts(ros={"distro": "noetic"}, ros1={"master": "External", "uri": "http://m:1"}) == []
    assert parts(ros2={"rmw": "rmw_cyclonedds_cpp"}) == []
    assert parts(ros2={"discovery": {"mode": "Multicast"}}) == []


def test_the_headless_service_publishes_starting_pods_of_the_instance() -> None:
    service = peers_service(desired_of(make_app(), "amr-07"))
    assert service.spec["clusterIP"] == "None"
    assert service.spec["publishNotReadyAddresses"] is True
    assert service.spec["selector"] == {"robotics.io/app": "teleop", "robotics.io/instance": "amr-07"}


def test_infrastructure_of_a_stopped_instance_has_no_pods() -> None:
    stopped = infrastructure(desired_of(make_app(), ""), running=False)
    assert {child.spec["replicas"] for child in stopped if child.ref.kind == DEPLOYMENT} == {0}


def test_servers_listen_on_the_pods_own_address_where_that_is_ipv6() -> None:
    """By itself a server listens on IPv4 alone, and `-l ::` ends it, as seen with Fast DDS 2.9."""
    app = replace(make_app(), helper_defaults=HelperDefaults(ip_family="IPv6"))
    for child in deployments(infrastructure(desired_of(app, ""), running=True)):
        (container,) = pod_spec(child)["containers"]
        assert container["args"][-2:] == ["-l", "$(ROBOTAPP_POD_IP)"]
        address = {"name": "ROBOTAPP_POD_IP", "valueFrom": {"fieldRef": {"fieldPath": "status.podIP"}}}
        assert address in container["env"]
    for child in deployments(parts()):
        assert "-l" not in pod_spec(child)["containers"][0]["args"]
