"""A RobotApp made of a launch file works as it is written: the API's own checks find nothing, and each process starts what it did."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.factories import make_app
from tests.support.ros_sources import launch as read_launch
from tests.support.ros_sources import package

from robotapp_api.checks.spec import spec_notes, spec_problems
from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import Assessment, Hardware
from ros_profile.model.yaml_words import quote_text
from ros_profile.output.machine import as_rigelfile
from ros_profile.output.robotapp import as_robotapp, needs
from ros_profile.output.values import quote_unreadable, read_value

REALSENSE = """
<launch><node pkg="realsense2_camera" exec="realsense2_camera_node" name="camera" namespace="/camera"/></launch>
"""
LIDAR = 'serial::Serial port; p = n->create_publisher<sensor_msgs::msg::LaserScan>("scan", 1);'


def written(root: Path, files: Mapping[str, str], *, name: str = "up", file: str = "") -> str:
    package(root, name, files)
    profile = generate_profile(root)
    (chosen,) = [one for one in profile.packages[0].launches if one.file.endswith(file)]
    return as_robotapp(chosen, name=name, distro="jazzy")


def components(root: Path, files: Mapping[str, str], **more: Any) -> dict[str, dict[str, Any]]:
    """The components by name, after the API's checks found no problem and had nothing to note of them."""
    app = yaml.safe_load(written(root, files, **more))
    bodies = app["spec"]["components"]
    spec = make_app(*bodies, **{key: value for key, value in app["spec"].items() if key != "components"}).spec
    assert [str(one) for one in spec_problems(spec)] == []
    assert [str(one) for one in spec_notes(spec) if "components" in one.field] == []
    return {one["name"]: one for one in bodies}


def driver(body: str) -> dict[str, str]:
    return {
        "CMakeLists.txt": "project(up)\nadd_executable(run src/a.cpp)\n",
        "src/a.cpp": f'int main() {{ auto n = rclcpp::Node::make_shared("run"); {body} }}',
        "launch/a.launch.xml": '<launch><node pkg="up" exec="run"/></launch>',
    }


def test_a_usb_camera_claims_a_camera_and_not_any_usb_device(tmp_path: Path) -> None:
    camera = components(tmp_path, {"launch/a.launch.xml": REALSENSE})["camera"]
    assert camera["devices"] == [{"name": "video", "type": "video"}]
    assert "requires" not in camera


@pytest.mark.parametrize(
    ("types", "claimed"),
    [
        (("camera", "usb"), {"name": "video", "type": "video", "usbID": "8086:0b3a"}),
        (("usb",), {"name": "usb", "type": "usb", "usbID": "8086:0b3a"}),
    ],
)
def test_a_device_that_a_udev_rule_names_is_claimed_by_its_identity(
    types: tuple[str, ...], claimed: dict[str, str]
) -> None:
    hardware = [Hardware(kind, usb_id="8086:0b3a") for kind in types]
    assert needs(Assessment(None), hardware) == {"devices": [claimed]}


@pytest.mark.parametrize(
    ("body", "devices"),
    [
        ('SDL_JoystickOpen(0); p = n->create_publisher<sensor_msgs::msg::Joy>("joy", 1);', ["input"]),
        ("libusb_init(&c); libusb_open(d, &h);", []),
    ],
)
def test_no_bare_usb_device_is_ever_asked_for(tmp_path: Path, body: str, devices: list[str]) -> None:
    files = driver(body)
    claimed = components(tmp_path, files)["run"].get("devices", [])
    assert [one["type"] for one in claimed] == devices
    assert ("ask for it by its usbID" in written(tmp_path, files)) is (not devices)
    rigelfile = as_rigelfile(generate_profile(tmp_path))
    assert "type: usb" not in rigelfile
    assert ("ask for it by its usbID" in rigelfile) is (not devices)


@pytest.mark.parametrize(
    "parameter",
    [
        "channel_type: tcp",
        "connection: UDPv4",
        "use_tcp: true",
        "port: 'tcp://10.0.0.2:20108'",
        "comm_type: tcp_client",
    ],
)
def test_a_lidar_on_the_network_claims_no_serial_device(tmp_path: Path, parameter: str) -> None:
    key, _, value = parameter.partition(": ")
    node = (
        f"<node pkg='up' exec='run'><param name='{key}' value={value if value[0] in chr(39) else repr(value)}/></node>"
    )
    files = driver(LIDAR) | {"launch/a.launch.xml": f"<launch>{node}</launch>"}
    assert "devices" not in components(tmp_path, files)["run"]
    files["launch/a.launch.xml"] = "<launch><node pkg='up' exec='run'/></launch>"
    assert [one["type"] for one in components(tmp_path, files)["run"]["devices"]] == ["serial"]


@pytest.mark.parametrize(("value", "devices"), [("tcp", []), ("serial", ["serial"])])
def test_a_parameter_file_chooses_the_network_as_well(tmp_path: Path, value: str, devices: list[str]) -> None:
    node = "<node pkg='up' exec='run'><param from='$(find-pkg-share up)/config/c.yaml'/></node>"
    text = f"run:\n  ros__parameters:\n    channel_type: {value}\nother:\n  ros__parameters:\n    channel_type: udp\n"
    files = driver(LIDAR) | {"config/c.yaml": text, "launch/a.launch.xml": f"<launch>{node}</launch>"}
    assert [one["type"] for one in components(tmp_path, files)["run"].get("devices", [])] == devices


def test_a_parameter_file_of_the_workspace_becomes_a_field_of_the_component(tmp_path: Path) -> None:
    text = "/**:\n  ros__parameters:\n    rate: 20.0  # Hz\n"
    node = "<node pkg='up' exec='run'><param from='$(find-pkg-share up)/config/c.yaml'/><param from='/etc/robot/d.yaml'/></node>"
    files = driver("") | {"config/c.yaml": text, "launch/a.launch.xml": f"<launch>{node}</launch>"}
    made = components(tmp_path, files)["run"]
    assert made["parameters"] == [{"inline": text}]
    assert made["args"][-2:] == ["--params-file", "/etc/robot/d.yaml"]
    assert "parameters of" not in written(tmp_path, files)


def test_a_file_that_is_not_there_or_has_substitutions_is_named_in_a_comment(tmp_path: Path) -> None:
    node = "<node pkg='up' exec='run'><param from='$(find-pkg-share up)/config/c.yaml'/><param from='$(find-pkg-share far)/d.yaml'/></node>"
    text = "/**:\n  ros__parameters:\n    frame: $(var frame)\n"
    files = driver("") | {"config/c.yaml": text, "launch/a.launch.xml": f"<launch>{node}</launch>"}
    assert "parameters" not in components(tmp_path, files)["run"]
    assert {
        f"# run: parameters of {name} are not in the app; write the file under parameters"
        for name in ("up/config/c.yaml", "far/d.yaml")
    } <= set(written(tmp_path, files).splitlines())


CONTAINER = """
def generate_launch_description():
    return LaunchDescription([ComposableNodeContainer(
        name='box', namespace='/cams', package='rclcpp_components', executable='component_container_mt',
        composable_node_descriptions=[
            ComposableNode(package='p', plugin='p::A', name='a', namespace='/cams', remappings=[('image', 'raw')],
                           parameters=['cfg.yaml', {'serial_no': '0315', 'rate': 20.0, 'on': True, 'names': ['1', 'x']}]),
            ComposableNode(package='q', plugin='q::B', name="b'END")])])
"""


def test_a_container_loads_its_nodes_with_all_they_were_given(tmp_path: Path) -> None:
    text = "a:\n  ros__parameters: {gain: 1.0}\n"
    made = components(tmp_path, {"launch/a.launch.py": CONTAINER, "cfg.yaml": text})["box"]
    shell, option, script = made["args"]
    assert (shell, option) == ("bash", "-c")
    assert script.endswith("\nEND\nexec ros2 launch /tmp/box.launch.py\n")
    body = script.partition("<<'END'\n")[2].partition("\nEND\n")[0]
    compile(body, "box.launch.py", "exec")
    again, before = read_launch(body), read_launch(CONTAINER)
    facts = [(n.package, n.executable, n.plugin, n.name, n.namespace or "/", n.remaps) for n in again.nodes]
    assert facts == [(n.package, n.executable, n.plugin, n.name, n.namespace or "/", n.remaps) for n in before.nodes]
    assert again.nodes[1].parameters == before.nodes[1].parameters
    assert again.nodes[1].text_parameters == ("serial_no",)
    assert made["parameters"] == [{"inline": text}]
    assert "parameters=[FILES[0], {" in body


def test_a_component_without_a_container_gets_one(tmp_path: Path) -> None:
    text = """
        def generate_launch_description():
            return LaunchDescription([LoadComposableNodes(target_container='box', composable_node_descriptions=[
                ComposableNode(package='p', plugin='p::A', name='a')])])
    """
    script = components(tmp_path, {"launch/a.launch.py": text})["box"]["args"][2]
    assert "executable='component_container'" in script
    assert "plugin='p::A', name='a'" in script


def test_variables_and_what_stands_before_the_program_are_fields(tmp_path: Path) -> None:
    files = {
        "launch/a.launch.xml": """
        <launch><set_env name="BUFFERED" value="1"/><set_env name="ROS_DOMAIN_ID" value="7"/>
          <node pkg="p" exec="e" launch-prefix="chrt -f 80"><env name="OWN" value="2"/></node></launch>
        """
    }
    made = components(tmp_path, files)["e"]
    assert made["env"] == [{"name": "BUFFERED", "value": "1"}, {"name": "OWN", "value": "2"}]
    assert made["args"] == ["ros2", "run", "--prefix", "chrt -f 80", "p", "e"]
    assert "# e: variable ROS_DOMAIN_ID=7 is left out, because the operator sets it; write spec.ros2" in written(
        tmp_path, files
    )


@pytest.mark.parametrize(
    "text",
    ["031522070524", "1.0", "on", "Yes", "[*]", "a: b", "x #y", "", "nan", "it's", "{", "0x10", "~", "- a", "a\\b"],
)
def test_a_text_stays_the_same_text_when_ros_reads_it(text: str) -> None:
    quoted = quote_text(text)
    assert quoted == f"'{text.replace(chr(39), chr(39) * 2)}'"
    assert yaml.safe_load(quoted) == text


@pytest.mark.parametrize("text", ["base_link", "/dev/ttyUSB0", "front left", "a.b-c"])
def test_a_plain_text_is_not_quoted(text: str) -> None:
    assert quote_text(text) == quote_unreadable(text) == text == yaml.safe_load(text)


@pytest.mark.parametrize(
    ("text", "word", "value"),
    [
        ("20.0", "20.0", 20.0),
        ("true", "true", True),
        ("[1, 2]", "[1, 2]", [1, 2]),
        ("[*]", "'[*]'", "[*]"),
        ("a: b", "'a: b'", "a: b"),
        ("'1.0'", "'1.0'", "1.0"),
    ],
)
def test_a_value_that_yaml_cannot_read_is_a_text(text: str, word: str, value: object) -> None:
    assert quote_unreadable(text) == word
    assert read_value(text) == value
