"""A seeded sample of damaged files: no reader raises, each gives its own kind of answer."""

import random
from collections.abc import Callable
from typing import Any

import pytest
from tests.support.ros_sources import manifest

from campaigns.profile.profile_hostile import mutated
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import SourceFile
from ros_profile.read.launch.python import read_launch_python
from ros_profile.read.launch.xml_file import read_launch_xml
from ros_profile.read.launch.yaml_file import read_launch_yaml
from ros_profile.read.manifest import read_manifest
from ros_profile.read.parameters import read_parameters
from ros_profile.read.python.setup import read_setup_cfg, read_setup_py
from ros_profile.read.python.source import read_python

PYTHON = b"""
import rclpy
from rclpy.node import Node
RATES = {'a': 1.0, 'b': [2, 3]}
class A(Node):
    def __init__(self, x=1):
        super().__init__('a')
        self.p = self.create_publisher(String, f'{x}/t', QoSProfile(depth=10))
        self.t = self.create_timer(1.0 / self.get_parameter('rate').value, lambda: None)
        self.declare_parameters('', [('port', '/dev/ttyUSB0'), ('n', 3)])
def main(): rclpy.spin(A())
"""
LAUNCH = b"""
def one(name, x='a'): return Node(package='p', executable='e', name=name, remappings=[('a', x)])
def generate_launch_description():
    ld = LaunchDescription([DeclareLaunchArgument('ns', default_value='x')])
    for n in ['a', 'b']: ld.add_action(one(n, LaunchConfiguration('ns')))
    ld.add_action(GroupAction([PushRosNamespace('q'), IncludeLaunchDescription('x', launch_arguments={'a': 'b'}.items())]))
    return ld
"""
XML = b'<launch><arg name="a" default="$(eval 1 == 1)"/><group ns="x" if="$(arg a)"><node pkg="p" type="t" name="n"><param name="x" value="1"/></node></group></launch>'
YAML = b"launch:\n- arg: {name: a, default: 'b'}\n- group: [{node: {pkg: p, exec: e, param: [{name: x, value: 1}]}}]\n"
PARAMETERS = (
    b"/**:\n  node:\n    ros__parameters:\n      port: /dev/ttyACM0\n      list: [1, 2]\n      deep: {a: {b: c}}\n"
)
SETUP = b"setup(entry_points={'console_scripts': ['a = p.a:main']}, scripts=['scripts/b'])\n"
CFG = b"[options.entry_points]\nconsole_scripts =\n  a = p.a:main\n"

READERS: list[tuple[Callable[[bytes, str], Any], bytes, type]] = [
    (read_manifest, manifest("a", depends=("rclcpp",)).encode(), tuple),
    (read_python, PYTHON, SourceFile),
    (read_launch_python, LAUNCH, LaunchFile),
    (read_launch_xml, XML, LaunchFile),
    (read_launch_yaml, YAML, LaunchFile),
    (read_parameters, PARAMETERS, SourceFile),
    (read_setup_py, SETUP, SourceFile),
    (read_setup_cfg, CFG, SourceFile),
]


@pytest.mark.parametrize(("read", "data", "answer"), READERS, ids=lambda value: getattr(value, "__name__", ""))
def test_damaged_files_are_answered_like_any_other(
    read: Callable[[bytes, str], Any], data: bytes, answer: type
) -> None:
    for seed in range(30):
        assert isinstance(read(mutated(data, random.Random(seed)), "file"), answer), f"seed {seed}"
