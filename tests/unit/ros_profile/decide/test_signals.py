"""Every signal of a package's role and hardware, each on a small package of our own that holds nothing else."""

from collections.abc import Mapping
from pathlib import Path

import pytest
from tests.support.ros_sources import package, python_node, setup_py

from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import Assessment, PackageProfile

CMAKE = "project(p)\nadd_executable(run src/a.cpp)\n"


def judged(
    root: Path, files: Mapping[str, str], *, name: str = "thing", depends: tuple[str, ...] = (), ros: int = 2
) -> PackageProfile:
    package(root, name, files, depends=depends, ros=ros)
    (found,) = generate_profile(root, curated=False).packages
    return found


def qos(root: Path, files: Mapping[str, str], **more: object) -> str:
    found = judged(root, files, **more).assessment.qos_class  # type: ignore[arg-type]
    return found.value.value if found else "unknown"


def hardware(assessment: Assessment) -> set[str]:
    return {estimate.value.type for estimate in assessment.hardware}


def cpp(body: str, head: str = "") -> dict[str, str]:
    return {
        "CMakeLists.txt": CMAKE,
        "src/a.cpp": f'{head}\nint main() {{ auto n = rclcpp::Node::make_shared("n"); {body} }}',
    }


@pytest.mark.parametrize(
    ("base", "wanted"),
    [
        ("controller_interface::ControllerInterface", "realtime"),
        ("hardware_interface::SystemInterface", "realtime"),
        ("nav2_core::Controller", "realtime"),
        ("nav_core::BaseLocalPlanner", "realtime"),
        ("nav2_core::GlobalPlanner", "system_default"),
        ("nav2_costmap_2d::Layer", "sensor_data"),
        ("rviz_common::Display", "best_effort"),
    ],
)
def test_the_base_class_of_a_plugin_is_its_role(tmp_path: Path, base: str, wanted: str) -> None:
    files = {"src/a.cpp": f"class A : public {base} {{}};\nPLUGINLIB_EXPORT_CLASS(t::A, {base})"}
    assert qos(tmp_path, files) == wanted


def test_a_plugin_description_alone_tells_the_role(tmp_path: Path) -> None:
    text = '<library path="x"><class type="t::A" base_class_type="nav2_core::Behavior"/></library>'
    assert qos(tmp_path, {"plugins.xml": text}) == "realtime"


def test_a_broadcaster_is_no_controller(tmp_path: Path) -> None:
    base = "controller_interface::ControllerInterface"
    files = {
        "src/a.cpp": f"class ImuBroadcaster : public {base} {{}};\nPLUGINLIB_EXPORT_CLASS(t::ImuBroadcaster, {base})"
    }
    assert qos(tmp_path, files) == "sensor_data"


def test_what_loads_controllers_runs_their_loop(tmp_path: Path) -> None:
    assert qos(tmp_path, cpp("pluginlib::ClassLoader<nav2_core::Controller> l;")) == "realtime"


def test_publishing_commands_is_realtime(tmp_path: Path) -> None:
    assert qos(tmp_path, cpp('p = n->create_publisher<geometry_msgs::msg::Twist>("out", 1);')) == "realtime"


def test_commands_hidden_behind_a_wrapper_or_an_alias_are_seen(tmp_path: Path) -> None:
    wrapped = 'p = std::make_unique<nav2_util::TwistPublisher>(n, "out", 1);'
    aliased = 'p = n->create_publisher<Cmd>("out", 1);'
    assert qos(tmp_path / "a", cpp(wrapped)) == "realtime"
    assert qos(tmp_path / "b", cpp(aliased, "using Cmd = trajectory_msgs::msg::JointTrajectory;")) == "realtime"


def test_an_alias_of_a_header_is_seen_in_the_source(tmp_path: Path) -> None:
    files = cpp('p = n->create_publisher<Cmd>("out", 1);', '#include "a.hpp"') | {
        "src/a.hpp": "using Cmd = geometry_msgs::msg::Twist;"
    }
    assert qos(tmp_path, files) == "realtime"


def test_subscribing_commands_is_realtime(tmp_path: Path) -> None:
    assert qos(tmp_path, cpp('s = n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, f);')) == "realtime"


def test_publishing_sensor_types_is_sensor_data_also_in_python(tmp_path: Path) -> None:
    assert qos(tmp_path / "a", cpp('p = n->create_publisher<sensor_msgs::msg::LaserScan>("out", 1);')) == "sensor_data"
    python = {**python_node("eye", "self.create_publisher(Image, 'out', 10)"), **setup_py("eye")}
    assert qos(tmp_path / "b", python) == "sensor_data"


def test_a_velocity_measured_beside_a_position_is_no_command(tmp_path: Path) -> None:
    body = 'a = n->create_publisher<sensor_msgs::msg::NavSatFix>("fix", 1); b = n->create_publisher<geometry_msgs::msg::TwistStamped>("vel", 1);'
    assert qos(tmp_path, cpp(body)) == "sensor_data"


def test_a_window_on_sensor_data_is_best_effort(tmp_path: Path) -> None:
    body = 's = n->create_subscription<sensor_msgs::msg::Image>("in", 1, f); cv::imshow("w", m);'
    assert qos(tmp_path, cpp(body), name="frame_viewer") == "best_effort"


def test_real_time_scheduling_is_realtime(tmp_path: Path) -> None:
    assert qos(tmp_path, cpp("sched_setscheduler(0, SCHED_FIFO, &p); mlockall(MCL_CURRENT);")) == "realtime"


def test_servers_without_streams_are_system_default(tmp_path: Path) -> None:
    assert qos(tmp_path, cpp('s = n->create_service<std_srvs::srv::Trigger>("go", f);')) == "system_default"


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("arm_description", "best_effort"),
        ("my_rqt_plot", "best_effort"),
        ("rover_gazebo", "best_effort"),
        ("keyboard_teleop", "realtime"),
        ("front_lidar", "sensor_data"),
        ("mission_planner", "system_default"),
        ("fake_lidar", "best_effort"),
    ],
)
def test_words_of_the_name_tell_a_role(tmp_path: Path, name: str, wanted: str) -> None:
    assert qos(tmp_path, cpp(""), name=name) == wanted


def test_a_launch_package_inherits_from_what_it_starts(tmp_path: Path) -> None:
    drive = cpp(
        's = n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, f); serial::Serial p("/dev/ttyUSB0");'
    )
    package(tmp_path, "wheels", drive)
    launch = (
        "def generate_launch_description():\n    return LaunchDescription([Node(package='wheels', executable='run')])\n"
    )
    package(tmp_path, "bringup", {"launch/a.launch.py": launch})
    found = {p.name: p.assessment for p in generate_profile(tmp_path, curated=False).packages}["bringup"]
    assert found.qos_class is not None
    assert (found.qos_class.value.value, hardware(found)) == ("realtime", {"serial"})


def test_what_is_off_by_default_is_not_inherited(tmp_path: Path) -> None:
    package(tmp_path, "wheels", cpp('s = n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, f);'))
    package(tmp_path, "plans", cpp('s = n->create_service<std_srvs::srv::Trigger>("go", f);'))
    launch = """
        <launch><arg name="drive" default="false"/><node pkg="plans" exec="run"/>
        <node pkg="wheels" exec="run" if="$(var drive)"/></launch>
    """
    package(tmp_path, "bringup", {"launch/a.launch.xml": launch})
    found = {p.name: p.assessment for p in generate_profile(tmp_path, curated=False).packages}["bringup"]
    assert found.qos_class is not None
    assert found.qos_class.value.value == "system_default"


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ('open("/dev/ttyACM0", O_RDWR);', {"serial"}),
        ('open("/dev/video0", O_RDWR); ioctl(f, VIDIOC_S_FMT, &x);', {"camera"}),
        ('open("/dev/input/js0", O_RDONLY);', {"usb"}),
        ("socket(PF_CAN, SOCK_RAW, CAN_RAW);", {"can"}),
        ("boost::asio::serial_port port(io);", {"serial"}),
        ("auto c = gpiod_chip_open(x);", {"gpio"}),
        ("libusb_init(&ctx);", {"usb"}),
        ("rs2::context c;", {"camera", "usb"}),
        ("cudaMalloc(&p, 1);", {"gpu"}),
        ("tcgetattr(0, &t);", set()),
        ('log("/dev/null");', set()),
    ],
)
def test_code_shows_the_device_it_opens(tmp_path: Path, body: str, wanted: set[str]) -> None:
    assert hardware(judged(tmp_path, cpp(body)).assessment) == wanted


def test_comments_documents_and_tests_show_no_device(tmp_path: Path) -> None:
    files = cpp('// open("/dev/ttyUSB0")') | {"README.md": "use /dev/ttyUSB0", "test/t.cpp": 'open("/dev/ttyUSB0");'}
    assert hardware(judged(tmp_path, files).assessment) == set()


def test_a_parameter_default_shows_the_device(tmp_path: Path) -> None:
    files = cpp("") | {"config/p.yaml": "n:\n  ros__parameters:\n    port: /dev/ttyUSB0\n"}
    assert hardware(judged(tmp_path, files).assessment) == {"serial"}


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("find_package(CUDAToolkit REQUIRED)", {"gpu"}),
        ("project(p LANGUAGES CXX CUDA)", {"gpu"}),
        ("target_link_libraries(run pigpio)", {"gpio"}),
        ("find_package(OpenCV REQUIRED)", set()),
    ],
)
def test_build_files_show_hardware(tmp_path: Path, line: str, wanted: set[str]) -> None:
    files = cpp("") | {"CMakeLists.txt": CMAKE + line}
    assert hardware(judged(tmp_path, files).assessment) == wanted


def test_a_udev_rule_gives_the_identity_of_the_device(tmp_path: Path) -> None:
    rule = 'ATTRS{idVendor}=="10c4", ATTRS{idProduct}=="ea60", SYMLINK+="lidar"\n'
    (device,) = judged(tmp_path, cpp('open("/dev/ttyUSB0", 1);') | {"udev/l.rules": rule}).assessment.hardware
    assert device.value.usb_id == "10c4:ea60"


def test_hardware_of_a_library_in_the_workspace_passes_to_what_links_it(tmp_path: Path) -> None:
    package(
        tmp_path, "bus_api", {"src/a.cpp": "void f() { libusb_init(&c); }", "include/bus_api/bus.hpp": "class Bus {};"}
    )
    package(tmp_path, "bus_node", cpp("Bus b;", "#include <bus_api/bus.hpp>"))
    found = {p.name: p.assessment for p in generate_profile(tmp_path, curated=False).packages}
    assert hardware(found["bus_node"]) == {"usb"}


def test_a_literal_period_beats_a_parameter_and_that_beats_the_usual(tmp_path: Path) -> None:
    stream = 'p = n->create_publisher<geometry_msgs::msg::Twist>("out", 1); '
    yaml = {"config/p.yaml": "n:\n  ros__parameters:\n    controller_frequency: 12.5\n"}
    usual = judged(tmp_path / "a", cpp(stream)).assessment
    given = judged(tmp_path / "b", cpp(stream) | yaml).assessment
    literal = judged(tmp_path / "c", cpp(stream + "t = n->create_wall_timer(100ms, f);") | yaml).assessment
    assert [a.deadline_s.value for a in (usual, given, literal) if a.deadline_s] == [0.05, 0.08, 0.1]


def test_a_sensor_profile_in_code_does_not_make_a_class(tmp_path: Path) -> None:
    body = 'p = n->create_publisher<geometry_msgs::msg::Twist>("out", rclcpp::SensorDataQoS());'
    assert qos(tmp_path, cpp(body)) == "realtime"


def test_a_lifecycle_node_is_one_and_components_are_executables(tmp_path: Path) -> None:
    files = {"src/a.cpp": "class A : public rclcpp_lifecycle::LifecycleNode {};\nRCLCPP_COMPONENTS_REGISTER_NODE(t::A)"}
    found = judged(tmp_path, files)
    assert found.assessment.lifecycle
    assert [(e.kind, e.plugin) for e in found.executables] == [("component", "t::A")]


def test_nothing_known_is_unknown(tmp_path: Path) -> None:
    found = judged(tmp_path, {"CMakeLists.txt": CMAKE, "src/a.cpp": 'int main() { rclcpp::Node::make_shared("x"); }'})
    assert (found.assessment.qos_class, found.assessment.hardware) == (None, ())


def test_a_broadcaster_with_a_realtime_publisher_and_a_filter_is_still_none(tmp_path: Path) -> None:
    base = "controller_interface::ChainableControllerInterface"
    body = f"class ForceBroadcaster : public {base} {{ realtime_tools::RealtimePublisher<int> p; }};"
    files = {"src/a.cpp": f"{body}\nPLUGINLIB_EXPORT_CLASS(t::ForceBroadcaster, {base})"}
    assert qos(tmp_path, files, depends=("controller_interface", "realtime_tools")) == "sensor_data"


@pytest.mark.parametrize(
    ("interface", "wanted"),
    [
        ("JointStateInterface", "sensor_data"),
        ("ImuSensorInterface", "sensor_data"),
        ("EffortJointInterface", "realtime"),
    ],
)
def test_a_controller_of_ros_1_that_is_given_states_only_reports_them(
    tmp_path: Path, interface: str, wanted: str
) -> None:
    head = f"class A : public controller_interface::Controller<hardware_interface::{interface}> {{}};"
    files = {"src/a.cpp": f"{head}\nPLUGINLIB_EXPORT_CLASS(t::A, controller_interface::ControllerBase)"}
    assert qos(tmp_path, files, ros=1) == wanted


def test_a_window_that_drives_the_robot_is_operator_input(tmp_path: Path) -> None:
    plugin = '<library path="x"><class type="t.Steer" base_class_type="rqt_gui_py::Plugin"/></library>'
    code = "import rospy\nfrom geometry_msgs.msg import Twist\nrospy.Publisher('cmd_vel', Twist, queue_size=1)\n"
    assert qos(tmp_path / "a", {"plugin.xml": plugin}) == "best_effort"
    assert qos(tmp_path / "b", {"plugin.xml": plugin, "src/t/steer.py": code}) == "realtime"


def test_images_out_of_a_simulator_are_simulation(tmp_path: Path) -> None:
    image = 'p = n->create_publisher<sensor_msgs::msg::Image>("image", 1);'
    assert qos(tmp_path / "a", cpp(image), name="gz_image") == "sensor_data"
    assert qos(tmp_path / "b", cpp(image, head="#include <gz/transport/Node.hh>"), name="gz_image") == "best_effort"


def test_a_serial_line_without_sensor_types_is_a_link_to_a_controller(tmp_path: Path) -> None:
    made = (
        's = n->create_subscription<my_msgs::msg::Wanted>("set_position", 1, f); serial::Serial port("/dev/ttyUSB0");'
    )
    assert qos(tmp_path, cpp(made)) == "realtime"


def test_what_is_started_on_a_condition_counts_where_nothing_else_has_a_class(tmp_path: Path) -> None:
    package(tmp_path, "driver", {**cpp('p = n->create_publisher<sensor_msgs::msg::Image>("a", 1);')})
    launch = (
        '<launch><arg name="model"/><node pkg="elsewhere" exec="x"/>'
        '<node pkg="driver" exec="run" if="$(eval \'&quot;$(var model)&quot; == &quot;a&quot;\')"/></launch>'
    )
    package(tmp_path, "start", {"launch/a.launch.xml": launch})
    found = {one.name: one for one in generate_profile(tmp_path, curated=False).packages}["start"].assessment.qos_class
    assert found is not None
    assert found.value.value == "sensor_data"


def test_a_dummy_is_a_simulation_and_a_converter_of_streams_is_no_tool(tmp_path: Path) -> None:
    scan = 'p = n->create_publisher<sensor_msgs::msg::LaserScan>("a", 1);'
    cloud = 's = n->create_subscription<sensor_msgs::msg::PointCloud2>("b", 1, f);'
    assert qos(tmp_path / "a", cpp(scan), name="dummy_lasers") == "best_effort"
    assert qos(tmp_path / "b", cpp(scan + cloud), name="cloud_to_line_converter") == "sensor_data"


def test_a_camera_on_the_firewire_library_is_a_camera(tmp_path: Path) -> None:
    found = judged(tmp_path, cpp("", head="#include <dc1394/dc1394.h>"))
    assert hardware(found.assessment) == {"camera"}


def test_a_deadline_is_the_nodes_own_period_also_when_it_is_slower_than_is_usual(tmp_path: Path) -> None:
    found = judged(
        tmp_path,
        cpp(
            'n->declare_parameter<double>("update_rate", 20.0); p = n->create_publisher<sensor_msgs::msg::Imu>("i", 1);'
        ),
    )
    for assessment in (found.assessment, found.executables[0].assessment):
        assert assessment.deadline_s is not None
        assert assessment.deadline_s.value == 0.05
        assert assessment.deadline_s.reason == "the period 50 ms (parameter update_rate)"


def test_the_times_of_a_package_are_those_of_its_programs_of_the_same_class(tmp_path: Path) -> None:
    files = {
        "CMakeLists.txt": "project(p)\nadd_executable(imu src/a.cpp)\nadd_executable(tool src/b.cpp)\n",
        "src/a.cpp": 'int main() { rclcpp::Node n("a"); t = create_wall_timer(50ms, std::bind(&A::publish, a)); '
        'p = n->create_publisher<sensor_msgs::msg::Imu>("i", 1); }',
        "src/b.cpp": 'int main() { rclcpp::Node n("b"); t = create_wall_timer(1ms, std::bind(&B::draw, b)); cv::imshow("a", b); }',
    }
    found = judged(tmp_path, files).assessment
    assert found.deadline_s is not None
    assert found.deadline_s.value == 0.05
