"""A device is required of what opens it: not of models, of controllers, or of a package that hands it to another node."""

from pathlib import Path

import pytest
from tests.support.ros_sources import package
from tests.unit.ros_profile.decide.test_signals import CMAKE, cpp, hardware, judged

from ros_profile.generate import generate_profile

NODE = """
def generate_launch_description():
    port = LaunchConfiguration('port')
    return LaunchDescription([
        DeclareLaunchArgument('port', default_value='/dev/input/js0'),
        Node(package='{package}', executable='run', parameters=[{{'dev': port}}]),
    ])
"""


@pytest.mark.parametrize(("starts", "wanted"), [("thing", {"usb"}), ("elsewhere", set())])
def test_a_device_that_a_launch_file_hands_on_is_that_of_the_node_it_goes_to(
    tmp_path: Path, starts: str, wanted: set[str]
) -> None:
    files = cpp('p = n->create_publisher<geometry_msgs::msg::Twist>("out", 1);')
    found = judged(tmp_path, {**files, "launch/a.launch.py": NODE.format(package=starts)})
    assert hardware(found.assessment) == wanted


@pytest.mark.parametrize(("starts", "wanted"), [("thing", {"camera"}), ("elsewhere", set())])
def test_a_device_in_a_parameter_file_is_that_of_the_node_that_takes_the_file(
    tmp_path: Path, starts: str, wanted: set[str]
) -> None:
    launch = (
        f'<launch><node pkg="{starts}" exec="run"><param from="$(find-pkg-share thing)/config/c.yaml"/></node></launch>'
    )
    files = {
        **cpp('p = n->create_publisher<std_msgs::msg::String>("out", 1);'),
        "config/c.yaml": "/**:\n  ros__parameters:\n    video_device: /dev/video0\n",
        "launch/a.launch.xml": launch,
    }
    assert hardware(judged(tmp_path, files).assessment) == wanted


def test_a_package_that_only_launches_needs_the_devices_it_hands_on(tmp_path: Path) -> None:
    found = judged(tmp_path, {"launch/a.launch.py": NODE.format(package="elsewhere")}, name="rover_bringup")
    assert hardware(found.assessment) == {"usb"}


def test_a_launch_fragment_and_a_helper_for_launch_files_are_no_programs(tmp_path: Path) -> None:
    files = {
        "launch/a.launch.py": NODE.format(package="elsewhere"),
        "launch/part.launch.py": "class Part:\n    pass\n",
        "thing/__init__.py": "",
        "thing/load.py": "def load(path):\n    return open(path).read()\n",
    }
    found = judged(tmp_path, files)
    assert [executable.name for executable in found.executables] == []
    assert hardware(found.assessment) == {"usb"}


@pytest.mark.parametrize("name", ["rover_description", "rover_viz", "rover_gazebo"])
def test_models_views_and_worlds_open_no_device_and_are_no_program(tmp_path: Path, name: str) -> None:
    files = {
        "urdf/a.urdf.xacro": '<robot><ros2_control><hardware><param name="port">/dev/ttyUSB0</param></hardware></ros2_control></robot>',
        "launch/view.launch.xml": '<launch><node pkg="controller_manager" exec="ros2_control_node"/></launch>',
    }
    package(tmp_path, name, files)
    (found,) = generate_profile(tmp_path).packages
    assert hardware(found.assessment) == set()
    assert found.assessment.qos_class is not None
    assert found.assessment.qos_class.value.value == "best_effort"


def test_a_controller_named_like_pins_opens_none(tmp_path: Path) -> None:
    base = "controller_interface::ControllerInterface"
    files = {"src/a.cpp": f"class A : public {base} {{}};\nPLUGINLIB_EXPORT_CLASS(t::A, {base})"}
    assert hardware(judged(tmp_path, files, name="gpio_controllers").assessment) == set()


def test_a_header_of_the_kernel_alone_is_no_can_bus(tmp_path: Path) -> None:
    include = "#include <linux/can.h>"
    assert hardware(judged(tmp_path / "a", cpp("", head=include)).assessment) == set()
    assert hardware(judged(tmp_path / "b", cpp("bind(s, AF_CAN);", head=include)).assessment) == {"can"}


def test_a_library_passes_on_what_its_code_opens_and_not_what_its_launch_files_name(tmp_path: Path) -> None:
    user = {"CMakeLists.txt": CMAKE, "src/a.cpp": '#include "lib/open.hpp"\nint main() { rclcpp::Node n("a"); }'}
    launch = {"launch/a.launch": '<launch><node pkg="lib" type="run" args="/dev/ttyUSB0"/></launch>'}
    for name, files in {"named": launch, "opened": {"src/open.cpp": "serial::Serial port;"}}.items():
        root = tmp_path / name
        package(root, "user", user)
        package(root, "lib", {"include/lib/open.hpp": "class Open;", **files})
        found = {one.name: one for one in generate_profile(root, curated=False).packages}
        assert hardware(found["user"].assessment) == ({"serial"} if name == "opened" else set()), name
