"""What rclcpp and rclpy do alike is read alike: the same statement in C++ and Python is the same QoS."""

import pytest
from tests.support.ros_sources import source

from ros_profile.model.endpoints import Qos
from ros_profile.read.cpp import read_cpp


@pytest.mark.parametrize(
    ("cpp", "python"),
    [
        ("10", "10"),
        ("rclcpp::QoS(10)", "QoSProfile(depth=10)"),
        ("rclcpp::QoS(rclcpp::KeepLast(3))", "QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=3)"),
        ("rclcpp::QoS(rclcpp::KeepAll())", "QoSProfile(history=HistoryPolicy.KEEP_ALL)"),
        ("rclcpp::QoS(5).best_effort()", "QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)"),
        ("rclcpp::QoS(1).transient_local()", "QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)"),
        ("rclcpp::SensorDataQoS()", "qos_profile_sensor_data"),
        ("rclcpp::SystemDefaultsQoS()", "qos_profile_system_default"),
    ],
)
def test_the_same_statement_is_the_same_quality_of_service(cpp: str, python: str) -> None:
    assert _cpp(f'p = create_publisher<a::msg::B>("t", {cpp});') == _python(f"n.create_publisher(B, 't', {python})")


@pytest.mark.parametrize(
    ("cpp", "python"),
    [
        ('p = nh.advertise<a::B>("t", 7);', "rospy.Publisher('t', B, queue_size=7)"),
        ('p = nh.advertise<a::B>("t", 1, true);', "rospy.Publisher('t', B, queue_size=1, latch=True)"),
        ('s = nh.subscribe("t", 3, &on);', "rospy.Subscriber('t', B, on, queue_size=3)"),
    ],
)
def test_a_queue_size_of_ros_1_and_a_latch_are_read_alike(cpp: str, python: str) -> None:
    assert _cpp(cpp) == _python(python)


def _cpp(statement: str) -> Qos | None:
    (endpoint,) = read_cpp(f"void f() {{ {statement} }}".encode(), "a.cpp").endpoints
    return endpoint.qos


def _python(statement: str) -> Qos | None:
    return source(f"import rospy\n{statement}\n").endpoints[0].qos
