"""A seeded sample of damaged C++, CMake and XML: no reader raises, and parsing that gets stuck is given up."""

import random
import time
from collections.abc import Callable

import pytest

from campaigns.profile.profile_hostile import mutated
from ros_profile.model.package import SourceFile
from ros_profile.read.cmake import read_cmake
from ros_profile.read.cpp import read_cpp
from ros_profile.read.interfaces import read_interface
from ros_profile.read.parameters import read_parameters
from ros_profile.read.udev import read_udev
from ros_profile.read.xml_files import read_xml

CPP = b"""
#include "demo/driver.hpp"
using Scan = sensor_msgs::msg::LaserScan;
namespace demo {
class Driver : public rclcpp::Node {
 public:
  Driver() : Node("driver") {
    declare_parameter<std::string>("port", "/dev/ttyUSB0");
    scan_ = create_publisher<Scan>("scan", rclcpp::QoS(5).best_effort().deadline(100ms));
    cmd_ = create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 10, std::bind(&Driver::on, this, _1));
    timer_ = create_wall_timer(std::chrono::milliseconds(1000 / rate_), [this]() { read(R"(x)"); });
  }
};
}
RCLCPP_COMPONENTS_REGISTER_NODE(demo::Driver)
PLUGINLIB_EXPORT_CLASS(demo::Driver, demo::Base)
"""
CMAKE = b'project(a LANGUAGES CXX CUDA)\nset(S a.cpp "b.cpp")\nif(X)\nfind_package(B QUIET COMPONENTS c)\nendif()\nadd_executable(e ${S})\n'
XML = b'<library path="x"><class type="a::B" base_class_type="c::D"><description>x</description></class></library>'
RULES = b'SUBSYSTEM=="tty", ATTRS{idVendor}=="0403", SYMLINK+="a"\n'
ACTION = b"int32 a\n---\nbool b\n---\nfloat32 c # d\n"
READERS: list[tuple[Callable[[bytes, str], SourceFile], bytes]] = [
    (read_cpp, CPP),
    (read_cmake, CMAKE),
    (read_xml, XML),
    (read_udev, RULES),
    (read_interface, ACTION),
]


@pytest.mark.parametrize(("read", "data"), READERS, ids=lambda value: getattr(value, "__name__", ""))
def test_damaged_files_are_answered(read: Callable[[bytes, str], SourceFile], data: bytes) -> None:
    for seed in range(40):
        assert isinstance(read(mutated(data, random.Random(seed)), "msg/A.action"), SourceFile), f"seed {seed}"


def test_pieces_that_repeat_cost_no_more_than_a_source_of_the_same_length() -> None:
    length = 60_000
    usual = _seconds(CPP * (length // len(CPP)))
    for piece in (
        b"a<",
        b"class A : public ",
        b"/*",
        b'"',
        b"(",
        b"f(a,",
        b'get_parameter("a", ',
        b"using a = ",
        b"create_publisher<",
        b'create_publisher<a>("b", c);\n',
        b"create_timer(abc, d);\n",
    ):
        assert _seconds(piece * (length // len(piece))) < 10 * usual + 0.2, piece


@pytest.mark.parametrize(
    ("read", "file", "piece"),
    [
        (read_interface, "msg/A.msg", "\n"),
        (read_interface, "msg/A.srv", "# a\n"),
        (read_interface, "msg/A.action", "--- \n"),
        (read_parameters, "a.yaml", "k{}: 1\n"),
        (read_parameters, "b.yaml", "- {{a: 1, k{}: 1}}\n"),
    ],
)
def test_four_times_the_lines_cost_no_square_of_the_time(
    read: Callable[[bytes, str], SourceFile], file: str, piece: str
) -> None:
    def data(lines: int) -> bytes:
        return "".join(piece.format(number) for number in range(lines)).encode()

    short, long = (min(_seconds(data(lines), read, file) for _ in range(3)) for lines in (5_000, 20_000))
    assert long < 10 * short + 0.05, "four times as many lines: 4 when it is linear, 16 when it is not"


@pytest.mark.parametrize("letter", ["a", "0", "ã"])
def test_a_rule_of_one_long_word_costs_no_more_than_one_of_many(letter: str) -> None:
    long, many = ((piece * 2000)[:1900] + "\n" for piece in (letter, 'ATTRS{idVendor}=="0403", '))
    assert _seconds((long * 200).encode(), read_udev) < 10 * _seconds((many * 200).encode(), read_udev) + 0.05


def _seconds(data: bytes, read: Callable[[bytes, str], SourceFile] = read_cpp, file: str = "a.cpp") -> float:
    begun = time.process_time()
    read(data, file)
    return time.process_time() - begun
