"""Both nodes on one machine, with the parameters of config/teleop.yaml."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    parameters = str(Path(get_package_share_directory("reference_teleop")) / "config" / "teleop.yaml")
    return LaunchDescription(
        [
            Node(package="reference_teleop", executable="operator", name="operator", parameters=[parameters]),
            Node(package="reference_teleop", executable="robot", name="robot", parameters=[parameters]),
        ]
    )
