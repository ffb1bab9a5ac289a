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
