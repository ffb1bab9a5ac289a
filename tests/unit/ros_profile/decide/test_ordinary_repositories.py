"""Class, hardware and edges of packages as students, labs and small companies write them, each on a package of our own."""

from pathlib import Path

import pytest
from tests.support.ros_sources import package
from tests.unit.ros_profile.decide.test_signals import cpp, hardware, judged

from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import Assessment, LaunchProfile

PAIR = {
    "CMakeLists.txt": """
        project(pair)
        add_library(source SHARED src/source.cpp)
        rclcpp_components_register_node(source PLUGIN "ns::Source" EXECUTABLE source_node)
        add_library(sink SHARED src/sink.cpp)
        rclcpp_components_register_node(sink PLUGIN "ns::Sink" EXECUTABLE "sink_node")
    """,
    "src/source.cpp": """
        namespace ns { class Source : public rclcpp::Node { explicit Source(const rclcpp::NodeOptions & o) : Node("source", o)
        { pub_ = create_publisher<sensor_msgs::msg::LaserScan>("scan", 10); } }; }
    """,
    "src/sink.cpp": """
        namespace ns { class Sink : public rclcpp::Node { explicit Sink(const rclcpp::NodeOptions & o) : Node("sink", o)
        { sub_ = create_subscription<sensor_msgs::msg::LaserScan>("scan", 10, f); } }; }
    """,
    "launch/a.launch.xml": '<launch><node pkg="pair" exec="source_node"/><node pkg="pair" exec="sink_node"/></launch>',
}


def launched(root: Path, name: str) -> LaunchProfile:
    return next(one for p in generate_profile(root).packages for one in p.launches if one.package == name)


def class_of(assessment: Assessment) -> str:
    return assessment.qos_class.value.value if assessment.qos_class else "unknown"


def test_the_program_of_a_component_is_that_component(tmp_path: Path) -> None:
    package(tmp_path, "pair", PAIR)
    found = launched(tmp_path, "pair")
    assert [(edge.topic, edge.source, edge.target) for edge in found.edges] == [("/scan", "/source", "/sink")]


FOREIGN = """
<launch>
  <arg name="use_bus" default="{used}"/><arg name="dev" default="can0"/>
  <group if="$(var use_bus)">
    <include file="$(find-pkg-share some_bus)/launch/b.launch.xml"><arg name="interface" value="$(var dev)"/></include>
  </group>
  <node pkg="thing" exec="run"/>
</launch>
"""


@pytest.mark.parametrize(("used", "doubted"), [("false", []), ("true", ["can"])])
def test_an_interface_that_only_a_foreign_launch_file_takes_is_no_device_of_the_package(
    tmp_path: Path, used: str, doubted: list[str]
) -> None:
    files = cpp('p = n->create_publisher<can_msgs::msg::Frame>("to_bus", 10);')
    found = judged(tmp_path, {**files, "launch/a.launch.xml": FOREIGN.format(used=used)}).assessment
    assert hardware(found) == set()
    assert [one.value.type for one in found.doubted] == doubted
    assert class_of(found) == "realtime"


HARDWARE_PLUGIN = """
    namespace {package} {{ class {name} : public hardware_interface::SystemInterface {{ int s = socket(PF_CAN, SOCK_RAW, 1); }}; }}
    PLUGINLIB_EXPORT_CLASS({package}::{name}, hardware_interface::SystemInterface)
"""


@pytest.mark.parametrize(
    ("name", "plugin", "wanted"),
    [
        ("arm_simulation", "ArmHW", "best_effort"),
        ("arm_hw", "MockArm", "best_effort"),
        ("arm_driver", "FakeHardware", "best_effort"),
        ("arm_hw", "ArmHW", "realtime"),
    ],
)
def test_a_plugin_that_stands_in_for_a_device_is_a_simulation(
    tmp_path: Path, name: str, plugin: str, wanted: str
) -> None:
    text = HARDWARE_PLUGIN.replace("int s = socket(PF_CAN, SOCK_RAW, 1);", "").format(package=name, name=plugin)
    files = {"CMakeLists.txt": f"project({name})\nadd_library(hw SHARED src/hw.cpp)", "src/hw.cpp": text}
    assert class_of(judged(tmp_path, files, name=name).assessment) == wanted


LINE = 'int fd = open("/dev/ttyUSB0", O_RDWR); termios t; cfsetispeed(&t, B57600);'


@pytest.mark.parametrize(
    ("name", "body", "wanted"),
    [
        ("angle_interface", 'n->create_publisher<sensor_msgs::msg::JointState>("joint_states", 10);', "sensor_data"),
        ("battery_link", 'n->create_publisher<sensor_msgs::msg::BatteryState>("battery", 10);', "sensor_data"),
        ("status_lights", 'n->create_subscription<std_msgs::msg::String>("color", 10, f);', "system_default"),
        ("beacon_lamp", 'n->create_subscription<std_msgs::msg::ColorRGBA>("color", 10, f);', "system_default"),
        ("arm_driver", 'n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 10, f);', "realtime"),
    ],
)
def test_a_serial_line_that_only_reports_or_lights_is_no_control(
    tmp_path: Path, name: str, body: str, wanted: str
) -> None:
    found = judged(tmp_path, cpp(f"{LINE} p = {body}"), name=name, depends=("sensor_msgs",)).assessment
    assert class_of(found) == wanted
    assert hardware(found) == {"serial"}


CAMERA = """
def generate_launch_description():
    return LaunchDescription([Node(package="realsense2_camera", executable="realsense2_camera_node"),
                              Node(package="car_bringup", executable="run")])
"""


@pytest.mark.parametrize(("name", "wanted"), [("car_bringup", "sensor_data"), ("car_params", "unknown")])
def test_a_bringup_is_what_its_launch_files_start_whatever_helper_it_has(
    tmp_path: Path, name: str, wanted: str
) -> None:
    package(tmp_path, name, {**cpp(""), "launch/a.launch.py": CAMERA})
    (found,) = generate_profile(tmp_path).packages
    assert class_of(found.assessment) == wanted
    assert hardware(found.assessment) == ({"usb", "camera"} if wanted == "sensor_data" else set())


CONTROL = """
def generate_launch_description():
    model = Command([FindExecutable(name="xacro"), " ", PathJoinSubstitution([FindPackageShare("bot"), "urdf", "b.xacro"])])
    rates = PathJoinSubstitution([FindPackageShare("bot"), "config", "c.yaml"])
    return LaunchDescription([Node(package="controller_manager", executable="ros2_control_node",
                                   parameters=[{"robot_description": model}, rates])])
"""
MODEL = '<robot><ros2_control><hardware><plugin>{plugin}</plugin><param name="can">can0</param></hardware></ros2_control></robot>'


@pytest.mark.parametrize(
    ("plugin", "row", "wanted", "deadline"),
    [("bus_hw/BusHW", "RT-A", {"can"}, 0.005), ("mock_components/GenericSystem", "RT-B", set(), 0.005)],
)
def test_the_control_node_opens_what_its_plugins_open_at_their_rate(
    tmp_path: Path, plugin: str, row: str, wanted: set[str], deadline: float
) -> None:
    package(
        tmp_path,
        "bot",
        {
            "launch/b.launch.py": CONTROL,
            "urdf/b.xacro": MODEL.format(plugin=plugin),
            "config/c.yaml": "controller_manager:\n  ros__parameters:\n    update_rate: 200\n",
        },
        depends=("bus_hw",),
    )
    package(tmp_path, "bus_hw", {"src/hw.cpp": HARDWARE_PLUGIN.format(package="bus_hw", name="BusHW")})
    (node,) = launched(tmp_path, "bot").nodes
    assert hardware(node.assessment) == wanted
    assert node.assessment.sub_class is not None
    assert node.assessment.deadline_s is not None
    assert (node.assessment.sub_class.value.value, node.assessment.deadline_s.value) == (row, deadline)


def test_generated_launch_files_of_moveit_start_what_they_are_known_to_start(tmp_path: Path) -> None:
    text = """
        from moveit_configs_utils import MoveItConfigsBuilder
        from moveit_configs_utils.launches import generate_demo_launch
        def generate_launch_description():
            config = MoveItConfigsBuilder("arm", package_name="arm_moveit_config").to_moveit_configs()
            return generate_demo_launch(config)
    """
    package(tmp_path, "arm_moveit_config", {"launch/demo.launch.py": text})
    found = launched(tmp_path, "arm_moveit_config")
    assert "move_group" in {node.executable for node in found.nodes}
    assert found.problems == ()
    assert class_of(found.assessment) == "realtime"


def test_a_dependency_that_the_code_does_not_use_is_no_device(tmp_path: Path) -> None:
    unused = judged(tmp_path / "a", cpp(""), depends=("serial",)).assessment
    assert hardware(unused) == set()
    assert [one.value.type for one in unused.doubted] == ["serial"]
    used = judged(tmp_path / "b", cpp("", head="#include <serial/serial.h>"), depends=("serial",)).assessment
    assert hardware(used) == {"serial"}


def test_samples_of_a_library_do_not_decide_what_it_is(tmp_path: Path) -> None:
    sample = 'int main() { serial::Serial s; rclcpp::Node n("x"); n.create_publisher<geometry_msgs::msg::Twist>("cmd_vel", 1); }'
    files = {
        "CMakeLists.txt": "project(p)\nadd_library(l src/l.cpp)",
        "src/l.cpp": "int f();",
        "examples/a.cpp": sample,
    }
    found = judged(tmp_path, files, name="path_tools").assessment
    assert hardware(found) == set()
    assert class_of(found) == "best_effort"


def test_a_program_that_renders_or_computes_with_opengl_needs_a_gpu(tmp_path: Path) -> None:
    assert hardware(judged(tmp_path, cpp("glCreateShader(GL_VERTEX_SHADER);")).assessment) == {"gpu"}


@pytest.mark.parametrize(
    ("name", "made", "wanted"),
    [
        ("valve_unit", 'rclcpp_action::create_server<my_msgs::action::Open>(n, "open", f, g, h);', "system_default"),
        ("pump_unit", 'n->create_service<std_srvs::srv::SetBool>("pump", f);', "system_default"),
        ("pump_unit", 'n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, f);', "realtime"),
    ],
)
def test_what_a_device_does_once_on_request_is_no_loop(tmp_path: Path, name: str, made: str, wanted: str) -> None:
    found = judged(tmp_path, cpp(f"{LINE} s = {made}"), name=name).assessment
    assert class_of(found) == wanted
    assert hardware(found) == {"serial"}


def test_commands_that_are_written_as_texts_are_commands(tmp_path: Path) -> None:
    body = f'{LINE} s = n->create_subscription<std_msgs::msg::String>("motor_cmd", 1, f);'
    assert class_of(judged(tmp_path, cpp(body)).assessment) == "realtime"


BRIDGE = """
    #include "usb.hpp"
    void onDrive(const ackermann_msgs::AckermannDriveStamped::ConstPtr& msg);
    int main() {{ ros::init(c, v, "bridge"); ros::NodeHandle n; {line}
      p = n.advertise<sensor_msgs::Imu>("imu", 1); s = n.subscribe("drive", 1, onDrive); }}
"""


def test_a_bridge_to_a_microcontroller_takes_commands_by_a_plain_function(tmp_path: Path) -> None:
    files = {
        "CMakeLists.txt": "project(p)\nadd_executable(run src/a.cpp)\n",
        "src/a.cpp": BRIDGE.format(line=LINE),
        "include/usb.hpp": "int init(int speed);\n",
    }
    found = judged(tmp_path, files, name="microcontroller_bridge", ros=1).assessment
    assert class_of(found) == "realtime"
    assert hardware(found) == {"serial"}, "a header of its own is no library"


@pytest.mark.parametrize(
    ("name", "body", "wanted"),
    [
        ("height", f'{LINE} p = n->create_publisher<my_msgs::msg::HeightData>("height", 1);', "sensor_data"),
        ("beacon_positioning", f'{LINE} p = n->create_publisher<my_msgs::msg::Place>("place", 1);', "sensor_data"),
        ("drone_controls", 's = n->create_service<my_msgs::srv::Move>("move", f);', "realtime"),
        ("failsafe", 's = n->create_service<my_msgs::srv::Enable>("enable", f);', "realtime"),
        ("percher", 'p = n->create_publisher<geometry_msgs::msg::TwistStamped>("in/ref_twist", 1);', "realtime"),
    ],
)
def test_packages_with_messages_of_their_own_are_told_by_what_they_do(
    tmp_path: Path, name: str, body: str, wanted: str
) -> None:
    assert class_of(judged(tmp_path, cpp(body), name=name).assessment) == wanted


@pytest.mark.parametrize(("source", "wanted"), [("0", {"camera", "usb"}), ("'film.mp4'", set())])
def test_a_video_source_that_is_a_number_is_a_webcam(tmp_path: Path, source: str, wanted: set[str]) -> None:
    text = f"#!/usr/bin/env python3\nimport cv2, rospy\nrospy.init_node('c')\nv = cv2.VideoCapture({source})\n"
    assert hardware(judged(tmp_path, {"scripts/c.py": text}, ros=1).assessment) == wanted
