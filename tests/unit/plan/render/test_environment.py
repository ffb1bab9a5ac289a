"""ROS 2 variables per middleware, discovery mode and distribution."""

from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest
from tests.support.factories import component, make_app

from robotapp_api.checks.middleware import resolve_mode
from robotapp_operator.plan.render.environment import cyclone_config, ros2_environment
from robotapp_operator.plan.spec.desired import Desired, HelperDefaults, desired_of


def desired(rmw: str | None = None, *, distro: str = "humble", mode: str = "Auto", **ros2: object) -> Desired:
    fields = {"discovery": {"mode": mode}, **ros2, **({"rmw": rmw} if rmw else {})}
    return desired_of(make_app(component("a"), component("b"), ros={"distro": distro}, ros2=fields), "amr-07")


def variables(of: Desired) -> dict[str, str]:
    return {variable.name: variable.value for variable in ros2_environment(of, domain=7)}


def test_domain_and_middleware_come_first() -> None:
    first = ros2_environment(desired(), domain=7)[:2]
    assert [tuple(variable) for variable in first] == [
        ("ROS_DOMAIN_ID", "7"),
        ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp"),
    ]


@pytest.mark.parametrize(
    ("rmw", "mode"),
    [
        ("rmw_fastrtps_cpp", "Server"),
        ("rmw_fastrtps_dynamic_cpp", "Server"),
        ("rmw_cyclonedds_cpp", "Peers"),
        ("rmw_connextdds", "Peers"),
        ("rmw_zenoh_cpp", "Router"),
        ("rmw_gurumdds_cpp", "Multicast"),
    ],
)
def test_auto_chooses_what_works_without_multicast(rmw: str, mode: str) -> None:
    assert resolve_mode("Auto", rmw) == mode
    assert resolve_mode("Localhost", rmw) == "Localhost"


def test_fast_dds_clients_know_both_servers_in_the_order_of_their_ids() -> None:
    found = desired()
    assert variables(found)["ROS_DISCOVERY_SERVER"] == ";".join(f"{name}:11811" for name in found.server_names)
    assert len(found.server_names) == 2


def test_cyclone_peers_are_one_name_per_component_without_multicast() -> None:
    found = desired("rmw_cyclonedds_cpp")
    config = ET.fromstring(variables(found)["CYCLONEDDS_URI"])  # noqa: S314 - our own text
    addresses = [peer.get("Address") for peer in config.iter("Peer")]
    assert addresses == [f"a.{found.peers_service}", f"b.{found.peers_service}"]
    assert config.findtext("Domain/General/AllowMulticast") == "false"
    assert config.findtext("Domain/Discovery/ParticipantIndex") == "auto"


def test_names_in_the_cyclone_configuration_are_quoted() -> None:
    config = ET.fromstring(cyclone_config(['a"<b'], distro="humble"))  # noqa: S314 - our own text
    assert [peer.get("Address") for peer in config.iter("Peer")] == ['a"<b']


@pytest.mark.parametrize(
    ("distro", "patience"),
    [("galactic", None), ("humble", None), ("jazzy", None), ("kilted", None), ("lyrical", "inf"), ("rolling", "inf")],
)
def test_cyclone_never_gives_a_peer_up_where_it_can_be_told_so(distro: str, patience: str | None) -> None:
    """Cyclone DDS before 11 ends at an element it does not know, and asks for ever anyway."""
    config = ET.fromstring(variables(desired("rmw_cyclonedds_cpp", distro=distro))["CYCLONEDDS_URI"])  # noqa: S314 - our own text
    assert config.findtext("Domain/Discovery/InitialLocatorPruneDelay") == patience


def test_connext_peers_are_udp_locators() -> None:
    assert variables(desired("rmw_connextdds"))["NDDS_DISCOVERY_PEERS"].startswith("udpv4://a.")


def test_fast_dds_peers_use_the_variable_that_came_with_iron() -> None:
    found = desired(distro="jazzy", mode="Peers")
    assert variables(found)["ROS_STATIC_PEERS"] == ";".join(found.peer_names)


def test_zenoh_sessions_are_clients_of_the_router_and_wait_for_it() -> None:
    found = desired("rmw_zenoh_cpp", distro="jazzy")
    assert variables(found)["ZENOH_CONFIG_OVERRIDE"] == (
        f'mode="client";connect/endpoints=["tcp/{found.router_name}:7447"]'
    )
    assert variables(found)["ZENOH_ROUTER_CHECK_ATTEMPTS"] == "0"


@pytest.mark.parametrize(
    ("distro", "mode", "name", "value"),
    [
        ("humble", "Multicast", "ROS_LOCALHOST_ONLY", "0"),
        ("humble", "Localhost", "ROS_LOCALHOST_ONLY", "1"),
        ("foxy", "Localhost", "ROS_LOCALHOST_ONLY", "1"),
        ("iron", "Multicast", "ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
        ("jazzy", "Localhost", "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ("rolling", "Multicast", "ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET"),
    ],
)
def test_the_discovery_range_uses_the_variable_of_the_distribution(
    distro: str, mode: str, name: str, value: str
) -> None:
    found = variables(desired("rmw_fastrtps_cpp", distro=distro, mode=mode))
    assert found[name] == value
    assert len({"ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE"} & found.keys()) == 1


def test_udp_transport_turns_shared_memory_off_for_fast_dds_only() -> None:
    assert variables(desired(transport="UDP"))["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv4"
    assert "FASTDDS_BUILTIN_TRANSPORTS" not in variables(desired(transport="SHM"))
    assert "FASTDDS_BUILTIN_TRANSPORTS" not in variables(desired("rmw_cyclonedds_cpp", transport="UDP"))


def test_the_middleware_defaults_to_the_distributions() -> None:
    assert desired(distro="galactic").rmw == "rmw_cyclonedds_cpp"
    assert desired(distro="jazzy").rmw == "rmw_fastrtps_cpp"


def on_ipv6(rmw: str, **ros2: object) -> dict[str, str]:
    app = desired(rmw, **ros2).app
    return variables(desired_of(replace(app, helper_defaults=HelperDefaults(ip_family="IPv6")), "amr-07"))


@pytest.mark.parametrize("ros2", [{}, {"transport": "UDP"}, {"mode": "Multicast"}])
def test_fast_dds_speaks_ipv6_alone_where_the_pods_do(ros2: dict[str, object]) -> None:
    """With DEFAULTv6 servers are found and no data arrives between pods, as seen with Fast DDS 2.14."""
    assert on_ipv6("rmw_fastrtps_cpp", **ros2)["FASTDDS_BUILTIN_TRANSPORTS"] == "UDPv6"
    assert "FASTDDS_BUILTIN_TRANSPORTS" not in on_ipv6("rmw_cyclonedds_cpp")
    assert "FASTDDS_BUILTIN_TRANSPORTS" not in on_ipv6("rmw_fastrtps_cpp", mode="Localhost")


def test_cyclone_speaks_ipv6_to_peers_whose_names_have_no_other_address() -> None:
    config = ET.fromstring(on_ipv6("rmw_cyclonedds_cpp")["CYCLONEDDS_URI"])  # noqa: S314 - our own text
    assert config.findtext("Domain/General/Transport") == "udp6"
    assert config.findtext("Domain/General/AllowMulticast") == "false"
    assert "Transport" not in variables(desired("rmw_cyclonedds_cpp"))["CYCLONEDDS_URI"]
