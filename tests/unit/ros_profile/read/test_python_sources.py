"""What is read from Python sources: endpoints of rclpy and rospy, parameters, timers, names, QoS."""

import pytest
from tests.support.ros_sources import endpoints, source

from ros_profile.model.facts import Kind

ROS2 = """
    from rclpy.node import Node
    from geometry_msgs.msg import Twist as Command
    import sensor_msgs.msg
    from std_srvs.srv import Trigger
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionClient
"""


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("self.create_publisher(Command, 'cmd_vel', 10)", ("publisher", "cmd_vel", "geometry_msgs/msg/Twist")),
        (
            "self.create_publisher(msg_type=Command, topic='a', qos_profile=1)",
            ("publisher", "a", "geometry_msgs/msg/Twist"),
        ),
        ("self.create_subscription(sensor_msgs.msg.Image, 'i', f, 1)", ("subscription", "i", "sensor_msgs/msg/Image")),
        ("self.create_service(Trigger, '~/reset', f)", ("service_server", "~/reset", "std_srvs/srv/Trigger")),
        ("self.create_client(Trigger, TOPIC)", ("service_client", "/go/now", "std_srvs/srv/Trigger")),
        ("ActionClient(self, NavigateToPose, 'nav')", ("action_client", "nav", "nav2_msgs/action/NavigateToPose")),
        ("self.create_publisher(Command, f'{NAME}/out', 1)", ("publisher", "go/out", "geometry_msgs/msg/Twist")),
    ],
)
def test_rclpy_calls_give_endpoints_with_full_types(statement: str, expected: tuple[str, str, str]) -> None:
    text = f"{ROS2}\n    NAME = 'go'\n    TOPIC = '/' + NAME + '/now'\n    class A(Node):\n        def __init__(self):\n            {statement}\n"
    assert endpoints(text) == [expected]


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("rospy.Publisher('cmd_vel', Twist, queue_size=1)", ("publisher", "cmd_vel", "geometry_msgs/msg/Twist")),
        ("rospy.Subscriber('~in', Twist, f)", ("subscription", "~in", "geometry_msgs/msg/Twist")),
        ("rospy.Service('s', Trigger, f)", ("service_server", "s", "std_srvs/srv/Trigger")),
        (
            "actionlib.SimpleActionClient('move_base', MoveBaseAction)",
            ("action_client", "move_base", "move_base_msgs/action/MoveBase"),
        ),
    ],
)
def test_rospy_calls_give_endpoints_too(statement: str, expected: tuple[str, str, str]) -> None:
    imports = "import rospy, actionlib\nfrom geometry_msgs.msg import Twist\nfrom std_srvs.srv import Trigger\nfrom move_base_msgs.msg import MoveBaseAction\n"
    assert endpoints(imports + statement) == [expected]


def test_a_topic_that_a_parameter_names_is_marked_and_the_default_is_kept() -> None:
    found = source("""
        class A(Node):
            def __init__(self):
                self.topic = self.declare_parameter('scan_topic', '/scan').value
                self.create_subscription(LaserScan, self.topic, f, 10)
    """)
    assert [endpoint.name for endpoint in found.endpoints] == ["$param:scan_topic"]
    assert [(p.name, p.default) for p in found.parameters] == [("scan_topic", "/scan")]


@pytest.mark.parametrize(
    ("statement", "period_s", "parameter", "is_rate"),
    [
        ("self.create_timer(0.02, f)", 0.02, "", False),
        ("self.create_timer(1.0 / 50, f)", 0.02, "", False),
        ("self.create_rate(50)", 0.02, "", False),
        ("self.create_timer(self.get_parameter('period').value, f)", -1.0, "period", False),
        ("self.create_timer(1.0 / self.get_parameter('rate').value, f)", -1.0, "rate", True),
    ],
)
def test_timers_have_a_period_or_the_parameter_that_gives_it(
    statement: str, period_s: float, parameter: str, is_rate: bool
) -> None:
    timer = source(f"class A(Node):\n    def __init__(self):\n        {statement}\n").timers[0]
    assert (timer.period_s, timer.parameter, timer.parameter_is_rate) == (pytest.approx(period_s), parameter, is_rate)


def test_a_rate_of_rospy_is_a_period() -> None:
    timers = source("import rospy\nr = rospy.Rate(rospy.get_param('~hz', 20))\ns = rospy.Rate(20)\n").timers
    assert [(t.period_s, t.parameter) for t in timers] == [(-1.0, "hz"), (0.05, "")]


@pytest.mark.parametrize(
    ("qos", "stated"),
    [
        ("10", {"profile": "default", "reliability": "reliable", "history": "keep_last", "depth": 10}),
        ("QoSProfile(history=HistoryPolicy.KEEP_ALL)", {"reliability": "reliable", "history": "keep_all", "depth": -1}),
        ("qos_profile_sensor_data", {"profile": "sensor_data", "reliability": "best_effort", "depth": 5}),
        ("rclpy.qos.qos_profile_services_default", {"profile": "services_default", "reliability": "reliable"}),
        ("QoSPresetProfiles.SENSOR_DATA.value", {"profile": "sensor_data"}),
        (
            "QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)",
            {"depth": 1, "durability": "transient_local"},
        ),
        ("BEST", {"depth": 5, "reliability": "best_effort"}),
    ],
)
def test_qos_is_read_where_it_is_stated(qos: str, stated: dict[str, object]) -> None:
    text = f"BEST = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT)\nn.create_publisher(String, 'a', {qos})\n"
    found = source(text).endpoints[0].qos
    assert found is not None
    assert {key: getattr(found, key) for key in stated} == stated


def test_devices_libraries_and_base_classes_are_facts_with_their_line() -> None:
    found = source("""
        import serial
        from RPi import GPIO
        class Driver(Node):
            '''Reads /dev/ttyUSB9, as this text only tells.'''
            def __init__(self):
                self.port = serial.Serial('/dev/ttyUSB0', 115200)
                GPIO.setup(4, GPIO.OUT)
    """)
    facts = {(fact.kind, fact.subject, fact.line) for fact in found.facts}
    assert {
        (Kind.SYMBOL, "serial.Serial", 7),
        (Kind.SYMBOL, "RPi.GPIO.setup", 8),
        (Kind.DEVICE_PATH, "/dev/ttyUSB0", 7),
    } <= facts
    assert not any(subject == "/dev/ttyUSB9" for _, subject, _ in facts), "documentation is no evidence"
    assert (Kind.INHERITS, "Node", 4) in facts


def test_python_2_is_read_with_its_lines() -> None:
    found = source("""
        import rospy
        try:
            print "hello", 0755
        except Exception, error:
            print >>sys.stderr, error
        rospy.init_node('old')
        rospy.Publisher('a', String)
    """)
    assert found.problems == ()
    assert found.node_names == ("old",)
    assert [(endpoint.name, endpoint.line) for endpoint in found.endpoints] == [("a", 8)]


@pytest.mark.parametrize(
    "text",
    [
        "def (",
        "x = " + "(" * 3000,
        "a" + ".b" * 20_000,
        "x = " + "-" * 50_000 + "1",
        "\0",
        r"x = serial.Serial('/dev/ttyUSB0\ud800')",
        "if 1:\n\tx\n        y",
    ],
)
def test_what_is_no_python_is_a_problem_and_no_exception(text: str) -> None:
    found = source(text)
    assert found.file == "pkg/node.py"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_encodings_and_line_ends_do_not_matter(encoding: str) -> None:
    from ros_profile.read.python.source import read_python

    text = "# Gr\u00f6\u00dfe\r\nn.create_publisher(String, 'a', 1)\r\n"
    found = read_python(text.encode(encoding), "a.py")
    assert [(endpoint.name, endpoint.line) for endpoint in found.endpoints] == [("a", 2)]
