"""Evidence names files that are there, also where one package is judged by what another one holds."""

from pathlib import Path
from typing import Any

import pytest
from tests.support.ros_sources import package

from ros_profile.generate import generate_profile
from ros_profile.model.conclusions import Assessment, Estimate, PackageProfile
from ros_profile.model.facts import Fact
from ros_profile.output.text import text

DRIVER = {
    "CMakeLists.txt": "project(driver)\nadd_executable(run src/run.cpp)\n",
    "src/run.cpp": """
    #include <serial/serial.h>
    int main() {
      auto n = rclcpp::Node::make_shared("run");
      serial::Serial port("/dev/ttyUSB0", 115200);
      auto s = n->create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, f);
    }
    """,
}
LAUNCH = '<launch>\n<node pkg="driver" exec="run"><param name="port" value="/dev/ttyUSB7"/></node>\n{more}</launch>'


def bringup(root: Path, *, more: str = "") -> tuple[PackageProfile, PackageProfile]:
    package(root, "driver", DRIVER, depends=("geometry_msgs",))
    package(root, "bringup", {"launch/a.launch.xml": LAUNCH.format(more=more)})
    first, second = generate_profile(root).packages
    return (first, second) if first.name == "bringup" else (second, first)


def evidence(assessment: Assessment) -> list[Fact]:
    values: list[Any] = [getattr(assessment, name) for name in Assessment.__slots__]
    values += assessment.hardware
    return [fact for value in values if isinstance(value, Estimate) for fact in value.evidence]


def test_what_a_launch_file_starts_is_told_with_its_own_package(tmp_path: Path) -> None:
    launching, driver = bringup(tmp_path)
    found = evidence(launching.assessment)
    assert {fact.file for fact in found if fact.subject == "serial::Serial"} == {"driver/src/run.cpp"}
    assert "driver/package.xml" in {fact.file for fact in found}
    for fact in found:
        holder = tmp_path if fact.file.startswith("driver/") else tmp_path / "bringup"
        assert (holder / fact.file).is_file(), fact
    assert {fact.file for fact in evidence(driver.assessment)} <= {"src/run.cpp", "package.xml"}


def test_the_launch_file_itself_is_told_as_a_file_of_the_package(tmp_path: Path) -> None:
    launching, _ = bringup(tmp_path)
    places = {fact.place for fact in evidence(launching.launches[0].assessment) if fact.subject == "/dev/ttyUSB7"}
    assert places == {"launch/a.launch.xml:2"}


def test_a_device_of_a_linked_library_is_told_with_the_librarys_package(tmp_path: Path) -> None:
    files = {"CMakeLists.txt": "project(user)\nadd_executable(go src/go.cpp)\n"}
    package(tmp_path, "driver", DRIVER)
    package(tmp_path, "user", {**files, "src/go.cpp": '#include "driver/run.h"\nint main() {}\n'})
    (found,) = (one for one in generate_profile(tmp_path).packages if one.name == "user")
    (serial,) = (one for one in found.assessment.hardware if one.value.type == "serial")
    assert [fact.file for fact in serial.evidence] == ["src/go.cpp", *["driver/src/run.cpp"] * 2]


@pytest.mark.parametrize(
    ("started", "shown"),
    [
        ('<node pkg="joy" exec="joy_node"/>', "(table of well-known nodes)  publishes sensor_msgs/msg/Joy"),
        ('<node pkg="joy" exec="joy_node"/>', "(table of well-known packages)  curated joy (realtime usb)"),
        ('<node pkg="acme_teleop" exec="x"/>', "(its source is not here)  name "),
    ],
)
def test_a_node_without_source_is_told_as_such(tmp_path: Path, started: str, shown: str) -> None:
    package(tmp_path, "bringup", {"launch/a.launch.xml": f"<launch>{started}</launch>"})
    assert shown in text(generate_profile(tmp_path), explain=True)
