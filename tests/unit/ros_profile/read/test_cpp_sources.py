"""What is read from a C++ source: endpoints with types and QoS, timers, parameters, libraries, plug-ins."""

from textwrap import dedent

import pytest

from ros_profile.model.endpoints import Timer
from ros_profile.model.facts import Kind
from ros_profile.model.package import SourceFile
from ros_profile.read.cpp import read_cpp


def cpp(text: str, file: str = "src/a.cpp") -> SourceFile:
    return read_cpp(dedent(text).encode(), file)


def ends(text: str) -> list[tuple[str, str, str]]:
    return [(e.role.value, e.name, e.type) for e in cpp(text).endpoints]


def subjects(text: str, kind: Kind) -> list[str]:
    return [fact.subject for fact in cpp(text).facts if fact.kind is kind]


def only_timer(text: str) -> Timer:
    (timer,) = cpp(text).timers
    return timer


@pytest.mark.parametrize(
    ("code", "wanted"),
    [
        (
            'pub_ = create_publisher<sensor_msgs::msg::Image>("image", 10);',
            ("publisher", "image", "sensor_msgs/msg/Image"),
        ),
        ('auto p = node->create_publisher<std_msgs::msg::String>("a", 1);', ("publisher", "a", "std_msgs/msg/String")),
        ('p = rclcpp::create_publisher<a_msgs::msg::B>(node, "c", 1);', ("publisher", "c", "a_msgs/msg/B")),
        (
            's = create_subscription<std_msgs::msg::Bool>("stop", 1, cb);',
            ("subscription", "stop", "std_msgs/msg/Bool"),
        ),
        ('s = create_service<std_srvs::srv::Trigger>("go", cb);', ("service_server", "go", "std_srvs/srv/Trigger")),
        (
            'a = rclcpp_action::create_server<m::action::Dock>(this, "dock", x, y, z);',
            ("action_server", "dock", "m/action/Dock"),
        ),
        (
            'a = rclcpp_action::create_client<m::action::Dock>(this, "dock");',
            ("action_client", "dock", "m/action/Dock"),
        ),
        (
            'p = nh.advertise<geometry_msgs::Twist>("cmd_vel", 1, true);',
            ("publisher", "cmd_vel", "geometry_msgs/msg/Twist"),
        ),
        (
            'c = nh.serviceClient<std_srvs::Empty>("clear");',
            ("service_client", "clear", "std_srvs/srv/Empty"),
        ),
        ('p = it_.advertiseCamera("image", 1);', ("publisher", "image", "sensor_msgs/msg/Image")),
        (
            'p = std::make_unique<nav2_util::TwistPublisher>(node, "cmd_vel", 1);',
            ("publisher", "cmd_vel", "geometry_msgs/msg/Twist"),
        ),
        (
            'message_filters::Subscriber<sensor_msgs::LaserScan> scan(nh, "scan", 5);',
            ("subscription", "scan", "sensor_msgs/msg/LaserScan"),
        ),
    ],
)
def test_endpoints_of_both_generations_are_read(code: str, wanted: tuple[str, str, str]) -> None:
    assert ends(f"void f() {{ {code} }}") == [wanted]


def test_an_alias_stands_for_its_type() -> None:
    text = """
        using Scan = sensor_msgs::msg::LaserScan;
        namespace sm = sensor_msgs::msg;
        void f() { a = create_publisher<Scan>("a", 1); b = create_publisher<sm::Imu>("b", 1); }
    """
    assert [kind for _, _, kind in ends(text)] == ["sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Imu"]


def test_the_callback_tells_the_type_of_a_roscpp_subscription() -> None:
    text = """
        void Node::onScan(const sensor_msgs::LaserScan::ConstPtr& scan) {}
        void Node::start() { sub_ = nh_.subscribe("scan", 1, &Node::onScan, this); }
    """
    assert ends(text) == [("subscription", "scan", "sensor_msgs/msg/LaserScan")]


def test_a_topic_from_a_parameter_bears_its_name() -> None:
    text = """
        void f() {
          declare_parameter("scan_topic", "scan");
          get_parameter("scan_topic", topic_);
          s = create_subscription<a::msg::B>(topic_, 1, cb);
        }
    """
    assert ends(text) == [("subscription", "$param:scan_topic", "a/msg/B")]
    assert [(p.name, p.default) for p in cpp(text).parameters] == [("scan_topic", "scan")]


def test_classes_that_wrap_endpoints_are_known() -> None:
    text = """
        void f() {
          costmap_ = std::make_shared<nav2_costmap_2d::Costmap2DROS>("local_costmap", ns);
          std::string topic = declare_or_get_parameter("footprint_topic", std::string("a/footprint"));
          sub_ = std::make_unique<nav2_costmap_2d::FootprintSubscriber>(shared_from_this(), topic, *tf_);
        }
    """
    assert [(role, name) for role, name, _ in ends(text)] == [
        ("publisher", "local_costmap/costmap_raw"),
        ("publisher", "local_costmap/published_footprint"),
        ("subscription", "$param:footprint_topic"),
    ]


def test_a_topic_that_is_resolved_first_keeps_its_name() -> None:
    text = """
        void f() {
          std::string mono = node_base->resolve_topic_or_service_name("image_mono", false);
          pub_ = image_transport::create_publisher(this, mono, qos);
        }
    """
    assert ends(text) == [("publisher", "image_mono", "sensor_msgs/msg/Image")]


def test_comments_and_text_hold_no_endpoints() -> None:
    assert (
        ends('// create_publisher<a::msg::B>("a", 1);\n/* advertise<a::B>("c", 1) */ void f() { log("subscribe"); }')
        == []
    )


@pytest.mark.parametrize(
    ("argument", "reliability", "durability", "depth"),
    [
        ("10", "reliable", "volatile", 10),
        ("rclcpp::SensorDataQoS()", "best_effort", "volatile", 5),
        ("rclcpp::QoS(1).transient_local()", "reliable", "transient_local", 1),
        ("rclcpp::QoS(rclcpp::KeepLast(7)).best_effort()", "best_effort", "volatile", 7),
        ("rclcpp::SystemDefaultsQoS()", "", "", -1),
    ],
)
def test_qos_is_what_code_states(argument: str, reliability: str, durability: str, depth: int) -> None:
    (endpoint,) = cpp(f'void f() {{ p = create_publisher<a::msg::B>("a", {argument}); }}').endpoints
    assert endpoint.qos is not None
    assert (endpoint.qos.reliability, endpoint.qos.durability, endpoint.qos.depth) == (reliability, durability, depth)


def test_a_deadline_is_read_in_seconds() -> None:
    (endpoint,) = cpp('void f() { p = create_publisher<a::msg::B>("a", rclcpp::QoS(1).deadline(100ms)); }').endpoints
    assert endpoint.qos is not None
    assert endpoint.qos.deadline_s == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("code", "seconds"),
    [
        ("t = create_wall_timer(50ms, cb);", 0.05),
        ("t = create_wall_timer(std::chrono::milliseconds(20), cb);", 0.02),
        ("t = nh.createTimer(ros::Duration(0.1), cb);", 0.1),
        ("ros::Rate r(50);", 0.02),
        ("rclcpp::WallRate loop(10.0);", 0.1),
        ("const double hz = 100.0; t = create_timer(std::chrono::duration<double>(1.0 / hz), cb);", 0.01),
    ],
)
def test_periods_are_read(code: str, seconds: float) -> None:
    assert only_timer(f"void f() {{ {code} }}").period_s == pytest.approx(seconds)


def test_a_rate_from_a_parameter_names_it() -> None:
    timer = only_timer("""
        void f() {
          node->get_parameter("control_rate", rate_);
          double ms = 1000.0 / rate_;
          t = create_timer(std::chrono::milliseconds(static_cast<int>(ms)), cb);
        }
    """)
    assert (timer.parameter, timer.parameter_is_rate) == ("control_rate", True)


def test_the_owner_of_an_endpoint_is_its_class() -> None:
    (endpoint,) = cpp('namespace n { void Driver::start() { p = create_publisher<a::msg::B>("a", 1); } }').endpoints
    assert endpoint.owner == "Driver"


def test_registrations_give_plugins_and_components() -> None:
    source = cpp("""
        class C : public controller_interface::ControllerInterface {};
        PLUGINLIB_EXPORT_CLASS(n::C, controller_interface::ControllerInterface)
        RCLCPP_COMPONENTS_REGISTER_NODE(n::Cam)
    """)
    assert {(e.kind, e.plugin) for e in source.executables} == {("plugin", "n::C"), ("component", "n::Cam")}
    assert [f.subject for f in source.facts if f.kind is Kind.INHERITS] == ["controller_interface::ControllerInterface"]


def test_devices_and_libraries_are_facts() -> None:
    text = 'serial::Serial port("/dev/ttyUSB0"); int s = socket(PF_CAN, SOCK_RAW, 1); std::string i = "can0"; // "/dev/video0"'
    assert subjects(text, Kind.SYMBOL) == ["PF_CAN", "serial::Serial"]
    assert subjects(text, Kind.DEVICE_PATH) == ["/dev/ttyUSB0", "can0"]


@pytest.mark.parametrize(
    "data", [b"\xef\xbb\xbfvoid f(){}\r\n", b"\xff\xfe\x00", b"void f( {{{", b'R"(', b"/*", b'"', b""]
)
def test_any_bytes_are_answered(data: bytes) -> None:
    assert read_cpp(data, "a.cpp").language == "cpp"


@pytest.mark.parametrize(
    ("code", "runs"),
    [
        ("t = create_wall_timer(1s, std::bind(&Driver::check_connection, this));", "check_connection"),
        ("t = nh.createTimer(ros::Duration(0.1), &Driver::onTimer, this);", "onTimer"),
        ("t = create_wall_timer(1s, [this]() { pub_->publish(m); });", "publish"),
        ("t = create_wall_timer(1s, [this]() { RCLCPP_WARN(l, w); });", ""),
        ("rclcpp::Rate r(10); while (ok()) { pub->publish(m); r.sleep(); }", "publish"),
        ("rclcpp::Rate r(10); while (!ready) { r.sleep(); }", ""),
    ],
)
def test_a_timer_tells_what_it_runs(code: str, runs: str) -> None:
    assert [timer.runs for timer in cpp(f"void Driver::f() {{ {code} }}").timers] == [runs]
