"""Class, hardware and confidence of programs as teams write them: own messages, Python 2, devices by other names, bring-ups."""

from pathlib import Path

import pytest
from tests.support.ros_sources import package
from tests.unit.ros_profile.decide.test_ordinary_repositories import class_of, launched
from tests.unit.ros_profile.decide.test_signals import cpp, hardware, judged

from ros_profile.decide.classify.judge import calibrated
from ros_profile.generate import generate_profile

SCRIPT = "#!/usr/bin/env python3\nimport rospy\nrospy.init_node('n')\n"


def publishing(kind: str, topic: str, verb: str = "create_publisher") -> dict[str, str]:
    callback = "" if verb == "create_publisher" else ", f"
    return cpp(f'p = n->{verb}<{kind}>("{topic}", 1{callback});')


@pytest.mark.parametrize(
    ("kind", "topic", "wanted"),
    [
        ("my_msgs::msg::AntennaCmd", "antenna/goal", "realtime"),
        ("my_msgs::msg::ThrusterForces", "forces", "realtime"),
        ("my_msgs::msg::MotorState", "motor_state", "unknown"),
        ("my_msgs::msg::DepthReading", "level", "sensor_data"),
        ("std_msgs::msg::Float32", "altitude", "sensor_data"),
        ("std_msgs::msg::Float64", "thrusters/left", "realtime"),
        ("std_msgs::msg::Empty", "heartbeat", "realtime"),
    ],
)
def test_messages_of_ones_own_and_plain_numbers_are_told_by_their_names(
    tmp_path: Path, kind: str, topic: str, wanted: str
) -> None:
    found = class_of(judged(tmp_path, publishing(kind, topic)).assessment)
    assert found == wanted if wanted != "unknown" else found not in ("realtime", "sensor_data")


@pytest.mark.parametrize(
    ("name", "wanted"), [("robot_statemachine", "system_default"), ("robot_dialogue", "system_default")]
)
def test_a_coordinator_that_sends_commands_as_texts_is_no_control_loop(tmp_path: Path, name: str, wanted: str) -> None:
    files = cpp(
        's = n->create_subscription<std_msgs::msg::String>("command", 1, f);'
        'p = n->create_publisher<std_msgs::msg::String>("nav_command", 1);'
    )
    assert class_of(judged(tmp_path, files, name=name).assessment) == wanted


@pytest.mark.parametrize(("name", "wanted"), [("lidar_reader", "sensor_data"), ("scale_link", "realtime")])
def test_a_serial_line_of_a_package_named_like_a_sensor_is_no_control(tmp_path: Path, name: str, wanted: str) -> None:
    files = {f"{name}/port.py": "import serial\nclass Port:\n    line = serial.Serial('/dev/ttyUSB0')\n"}
    assert class_of(judged(tmp_path, files, name=name).assessment) == wanted


PYTHON_2 = (
    "#!/usr/bin/env python\nimport rospy, serial\nfrom geometry_msgs.msg import Twist\nrospy.init_node('n')\n"
    "port = serial.Serial('/dev/ttyUSB0')\nif x < -0.001: y = 0755\n{line}\n"
    "rospy.Subscriber('cmd_vel', Twist, f)\n"
)


@pytest.mark.parametrize("line", ["print 'a', 1", "if x: print 'a'", "print 'a'; z = 1", "while x: print x,"])
def test_a_line_of_python_2_hides_no_program(tmp_path: Path, line: str) -> None:
    found = judged(tmp_path, {"scripts/run.py": PYTHON_2.format(line=line)}, ros=1)
    assert class_of(found.assessment) == "realtime"
    assert hardware(found.assessment) == {"serial"}


def test_a_line_that_is_left_out_is_noted_and_a_file_of_such_lines_is_not_read(tmp_path: Path) -> None:
    found = judged(tmp_path / "a", {"scripts/run.py": PYTHON_2.format(line="if x: print 'a'")}, ros=1)
    assert [(one.line, one.message) for one in found.problems] == [(7, "this line is no Python 3 and is left out")]
    text = SCRIPT + "who goes there\n" * 30
    (problem,) = judged(tmp_path / "b", {"scripts/run.py": text}, ros=1).problems
    assert "is not Python" in problem.message


@pytest.mark.parametrize(
    ("path", "wanted"),
    [
        ("/dev/imu", {"serial"}),
        ("/dev/igvc_comm", {"serial"}),
        ("/dev/front_lidar", {"serial"}),
        ("/dev/bottom_cam", {"camera"}),
        ("/dev/joy_left", {"usb"}),
        ("/dev/widget", set()),
        ("/dev/loop0", set()),
    ],
)
def test_names_that_udev_gives_tell_what_hangs_there(tmp_path: Path, path: str, wanted: set[str]) -> None:
    assert hardware(judged(tmp_path, {"scripts/a.py": f"{SCRIPT}port = '{path}'\n"}, ros=1).assessment) == wanted


def test_a_device_in_a_sentence_for_people_is_not_opened(tmp_path: Path) -> None:
    text = "please do connect the board before you start, it is expected at /dev/ttyUSB0"
    assert hardware(judged(tmp_path, {"scripts/a.py": f"{SCRIPT}print('{text}')\n"}, ros=1).assessment) == set()


@pytest.mark.parametrize(
    ("made", "wanted"),
    [
        ("import minimalmodbus\nm = minimalmodbus.Instrument(port, 1)", {"serial"}),
        ("import pymodbus.client\nm = pymodbus.client.ModbusSerialClient(port)", {"serial"}),
        ("import pymodbus.client\nm = pymodbus.client.ModbusTcpClient(host)", set()),
        ("import odrive\nm = odrive.find_any()", {"usb"}),
        ("import pyfirmata\nm = pyfirmata.Arduino(port)", {"serial"}),
    ],
)
def test_libraries_of_small_devices(tmp_path: Path, made: str, wanted: set[str]) -> None:
    assert hardware(judged(tmp_path, {"scripts/a.py": f"{SCRIPT}{made}\n"}, ros=1).assessment) == wanted


@pytest.mark.parametrize(
    ("call", "wanted"), [("modbus_new_rtu(path, 1, 'N', 8, 1)", {"serial"}), ("modbus_new_tcp(ip, 1)", set())]
)
def test_modbus_is_a_serial_line_unless_it_goes_over_the_network(tmp_path: Path, call: str, wanted: set[str]) -> None:
    assert hardware(judged(tmp_path, cpp(f"m = {call};")).assessment) == wanted


def test_who_reads_a_joystick_is_operator_input(tmp_path: Path) -> None:
    text = f"{SCRIPT}import pygame\nfrom std_msgs.msg import UInt8\npygame.joystick.Joystick(0)\nrospy.Publisher('x', UInt8)\n"
    found = judged(tmp_path, {"scripts/a.py": text}, ros=1).assessment
    assert (class_of(found), hardware(found)) == ("realtime", {"usb"})


VIDEO = (
    "#!/usr/bin/env python3\nimport cv2, rospy\nfrom sensor_msgs.msg import Image\nrospy.init_node('c')\n"
    "p = rospy.Publisher('image', Image)\nv = cv2.VideoCapture({source})\n{more}\n"
)


@pytest.mark.parametrize(
    ("source", "more", "wanted"),
    [
        ("device", "", {"camera", "usb"}),
        ("pipeline, cv2.CAP_GSTREAMER", "", set()),
        ("name", "name = rospy.get_param('~filename', '')", set()),
        ("name", "rospy.Subscriber('raw', Image, f)", set()),
    ],
)
def test_a_video_source_of_who_publishes_pictures_is_a_webcam(
    tmp_path: Path, source: str, more: str, wanted: set[str]
) -> None:
    files = {"scripts/c.py": VIDEO.format(source=source, more=more)}
    assert hardware(judged(tmp_path, files, ros=1).assessment) == wanted


PINS = "import RPi.GPIO as GPIO\ndef set_up():\n    GPIO.setmode(GPIO.BCM)\n"


@pytest.mark.parametrize(("imported", "wanted"), [("pins", {"gpio"}), ("names", set())])
def test_an_imported_module_opens_what_it_imports_itself(tmp_path: Path, imported: str, wanted: set[str]) -> None:
    package(tmp_path, "board", {"board/__init__.py": "", "board/pins.py": PINS, "board/names.py": "A = 1\n"}, ros=1)
    package(tmp_path, "user", {"scripts/u.py": f"{SCRIPT}from board.{imported} import A\n"}, ros=1)
    found = {one.name: one for one in generate_profile(tmp_path, curated=False).packages}
    assert hardware(found["user"].assessment) == wanted


HELPER = {
    "setup.py": "from setuptools import setup\nsetup(entry_points={'console_scripts': ['goals = nav.goals:main']})\n",
    "nav/goals.py": "import rclpy\nfrom rclpy.action import ActionClient\nfrom nav2_msgs.action import NavigateToPose\ndef main():\n    n = rclpy.create_node('goals')\n    ActionClient(n, NavigateToPose, 'go')\n",
}
STARTED = ", ".join(
    f'Node(package="nav2_{name}", executable="{name}_server")' for name in ("controller", "planner", "behaviors")
)
NAVIGATION = f"""
def generate_launch_description():
    return LaunchDescription([{STARTED}, Node(package="nav", executable="goals")])
"""


def test_a_helper_of_what_its_launch_file_starts_has_the_class_of_that(tmp_path: Path) -> None:
    package(tmp_path, "nav", {**HELPER, "launch/n.launch.py": NAVIGATION})
    (found,) = generate_profile(tmp_path).packages
    assert class_of(found.assessment) == "realtime"


def test_a_simulation_is_one_whatever_controllers_its_launch_files_start(tmp_path: Path) -> None:
    package(tmp_path, "nav_simulation", {"launch/n.launch.py": NAVIGATION, "scripts/a.py": SCRIPT})
    (found,) = generate_profile(tmp_path).packages
    assert class_of(found.assessment) == "best_effort"


def test_a_bring_up_for_tests_is_judged_by_what_it_starts(tmp_path: Path) -> None:
    package(tmp_path, "car_test_bringup", {"launch/n.launch.py": NAVIGATION})
    (found,) = generate_profile(tmp_path).packages
    assert class_of(found.assessment) == "realtime"


def test_the_joystick_that_steers_moveits_display_is_no_part_of_a_configuration(tmp_path: Path) -> None:
    joystick = (
        '<launch><arg name="dev" default="/dev/input/js0"/><node pkg="joy" type="joy_node" name="joy"/>'
        '<node pkg="moveit_ros_visualization" type="moveit_joy.py" name="moveit_joy"/></launch>'
    )
    group = '<launch><node pkg="moveit_ros_move_group" type="move_group" name="move_group"/></launch>'
    files = {"launch/joystick_control.launch": joystick, "launch/move_group.launch": group}
    package(tmp_path, "arm_moveit_config", files, ros=1)
    (found,) = generate_profile(tmp_path).packages
    assert (class_of(found.assessment), hardware(found.assessment)) == ("system_default", set())


@pytest.mark.parametrize(("program", "wanted"), [("nmea_serial_driver", {"serial"}), ("nmea_socket_driver", set())])
def test_a_well_known_driver_over_the_network_needs_no_serial_line(
    tmp_path: Path, program: str, wanted: set[str]
) -> None:
    text = f'<launch><node pkg="nmea_navsat_driver" type="{program}" name="gps"/></launch>'
    package(tmp_path, "gps_start", {"launch/a.launch": text}, ros=1)
    assert hardware(launched(tmp_path, "gps_start").assessment) == wanted


def test_a_launch_helper_with_any_number_of_parts_of_a_path_is_followed(tmp_path: Path) -> None:
    text = """
        import os
        def _include(share, *parts):
            return IncludeLaunchDescription(PythonLaunchDescriptionSource(os.path.join(share, *parts)))
        def generate_launch_description():
            share = get_package_share_directory('robot_start')
            return LaunchDescription([_include(share, 'launch', 'mux.launch.py')])
    """
    mux = 'def generate_launch_description():\n    return LaunchDescription([Node(package="twist_mux", executable="twist_mux")])\n'
    package(tmp_path, "robot_start", {"launch/all.launch.py": text, "launch/mux.launch.py": mux})
    (found,) = (one for one in generate_profile(tmp_path).packages[0].launches if one.file.endswith("all.launch.py"))
    assert [node.package for node in found.nodes] == ["twist_mux"]
    assert found.problems == ()


def test_confidence_grows_with_probability() -> None:
    stated = [calibrated(number / 200) for number in range(201)]
    assert stated == sorted(stated)
    assert (stated[0], stated[-1]) == (0.0, 0.99)


@pytest.mark.parametrize(
    ("kind", "wanted"), [("std_msgs::msg::Empty", "sensor_data"), ("std_msgs::msg::Float64", "realtime")]
)
def test_a_signal_to_a_sensor_is_no_set_point(tmp_path: Path, kind: str, wanted: str) -> None:
    files = cpp(
        f's = n->create_subscription<{kind}>("zero_command", 1, f);'
        'p = n->create_publisher<sensor_msgs::msg::FluidPressure>("pressure", 1);'
    )
    assert class_of(judged(tmp_path, files, depends=("geometry_msgs",)).assessment) == wanted


@pytest.mark.parametrize("base", ["gazebo::SensorPlugin", "gz::sim::System", "mujoco_ros::MujocoPlugin"])
def test_a_sensor_of_a_simulator_is_a_simulation(tmp_path: Path, base: str) -> None:
    text = f'class A : public {base} {{ void f() {{ n->create_publisher<sensor_msgs::msg::Imu>("imu", 1); }} }};'
    files = {"CMakeLists.txt": "project(p)\nadd_library(a SHARED src/a.cpp)\n", "src/a.cpp": text}
    assert class_of(judged(tmp_path, files, name="robot_sensors").assessment) == "best_effort"


DESCRIBED = "<package format='3'><name>{name}</name><version>1.0.0</version><description>{text}</description>"
REST = "<maintainer email='a@example.org'>A</maintainer><license>MIT</license></package>"


@pytest.mark.parametrize(
    ("name", "text", "wanted"),
    [
        ("lift", "Lifts of the simulation", "best_effort"),
        ("lift", "TODO: Package description", "system_default"),
        ("simulation_lift", "The simulation_lift package", "best_effort"),
    ],
)
def test_a_description_tells_a_simulation_that_the_name_does_not(
    tmp_path: Path, name: str, text: str, wanted: str
) -> None:
    files = cpp('s = n->create_service<my_msgs::srv::Call>("call", f);')
    manifest = DESCRIBED.format(name=name, text=text) + REST
    assert class_of(judged(tmp_path, {**files, "package.xml": manifest}, name=name).assessment) == wanted


def test_a_window_is_no_control_loop_whatever_its_launch_file_starts(tmp_path: Path) -> None:
    window = "import rclpy, tkinter\ndef main():\n    rclpy.create_node('panel')\n    tkinter.Tk()\n"
    files = {"setup.py": HELPER["setup.py"], "nav/goals.py": window, "launch/n.launch.py": NAVIGATION}
    package(tmp_path, "nav", files)
    (found,) = generate_profile(tmp_path).packages
    assert class_of(found.assessment) == "best_effort"


def test_a_large_file_that_is_no_python_is_not_parsed_line_by_line(tmp_path: Path) -> None:
    text = PYTHON_2.format(line="if x: print 'a'") + "x = 1\n" * 20_000
    (problem,) = judged(tmp_path, {"scripts/run.py": text}, ros=1).problems
    assert "is not Python" in problem.message
