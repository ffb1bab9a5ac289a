"""What becomes of ROS: the distribution, the domain, the middleware, the master of ROS 1."""

import pytest
from tests.unit.cli.importing.compose import (
    find_lines,
    get_component,
    get_spec,
    get_verdict,
    import_one,
    import_services,
)

from robotapp_cli.importing.images import find_distro, is_without_ros
from robotapp_cli.importing.report import Verdict


@pytest.mark.parametrize(
    ("image", "distro"),
    [
        ("ros:humble-ros-base", "humble"),
        ("osrf/ros:noetic-desktop-full", "noetic"),
        ("registry.example:5000/team/nav2_jazzy", "jazzy"),
        ("dustynv/ros:foxy-pytorch-l4t-r32.7.1", "foxy"),
        ("ros:rolling", "rolling"),
        ("example/rolling-mill:2", ""),
        ("postgres:16", ""),
        ("ros@sha256:0123", ""),
    ],
)
def test_the_distribution_in_the_name_of_an_image(image: str, distro: str) -> None:
    assert find_distro(image) == distro


def test_images_that_never_have_ros() -> None:
    assert is_without_ros("docker.io/library/postgres:16")
    assert is_without_ros("eclipse-mosquitto")
    assert not is_without_ros("example/driver")


def test_a_database_is_no_ros_program() -> None:
    result = import_services(
        {"db": {"image": "postgres:16"}, "nav": {"image": "ros:jazzy"}, "x": {"image": "example/x:1"}}
    )
    assert get_component(result, "db")["ros"] == "None"
    assert "ros" not in get_component(result, "nav")
    assert any("ros: None" in message for _, message in find_lines(result, "services.x"))


def test_an_app_of_databases_is_without_ros() -> None:
    result = import_services({"db": {"image": "postgres:16"}})
    assert get_spec(result)["ros"] == {"distro": "none"}
    assert "ros" not in get_component(result, "db")


def test_no_distribution_or_two_of_them_are_marked() -> None:
    assert get_spec(import_services({"x": {"image": "example/x:1"}}))["ros"]["distro"] == "CHOOSE-A-DISTRO"
    both = import_services({"a": {"image": "ros:jazzy"}, "b": {"image": "ros:humble"}})
    assert get_spec(both)["ros"]["distro"] == "CHOOSE-A-DISTRO"
    assert get_verdict(both, "services") is Verdict.CHOOSE
    assert get_spec(import_services({"x": {"image": "example/x:1"}}, distro="jazzy"))["ros"]["distro"] == "jazzy"


@pytest.mark.parametrize(("written", "ros2"), [("42", {"domain": 42}), ("0", None), ("150", None), ("x", None)])
def test_the_domain_is_a_field_of_the_app_where_it_can_be_claimed(written: str, ros2: object) -> None:
    result = import_one({"environment": [f"ROS_DOMAIN_ID={written}"]})
    assert get_spec(result).get("ros2") == ros2
    assert "env" not in get_component(result)


def test_services_that_do_not_agree_have_no_common_domain_or_middleware() -> None:
    services = {
        name: {"image": "ros:jazzy", "environment": {"ROS_DOMAIN_ID": number, "RMW_IMPLEMENTATION": f"rmw_{name}"}}
        for name, number in (("a", 1), ("b", 2))
    }
    result = import_services(services)
    assert "ros2" not in get_spec(result)
    assert get_verdict(result, "services.b.environment.RMW_IMPLEMENTATION") is Verdict.LEFT_OUT


def test_middleware_and_its_configuration() -> None:
    result = import_one(
        {"environment": {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "CYCLONEDDS_URI": "file:///c.xml"}}
    )
    assert get_spec(result)["ros2"] == {"rmw": "rmw_cyclonedds_cpp"}
    assert get_component(result)["env"] == [{"name": "CYCLONEDDS_URI", "value": "file:///c.xml"}]


def test_a_master_in_the_file_becomes_the_operators_own() -> None:
    services = {
        "core": {"image": "ros:noetic", "command": "stdbuf -o L roscore"},
        "nav": {"image": "ros:noetic", "environment": ["ROS_MASTER_URI=http://core:11311"], "depends_on": ["core"]},
    }
    result = import_services(services)
    assert [component["name"] for component in get_spec(result)["components"]] == ["nav"]
    assert "ros1" not in get_spec(result)
    assert "dependsOn" not in get_component(result, "nav")
    assert get_verdict(result, "services.core.command") is Verdict.LEFT_OUT


def test_a_master_elsewhere_is_external() -> None:
    services = {"nav": {"image": "ros:noetic", "environment": ["ROS_MASTER_URI=http://10.0.0.2:11311"]}}
    assert get_spec(import_services(services))["ros1"] == {"master": "External", "uri": "http://10.0.0.2:11311"}
