"""A coordinator and three robots on one machine."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    parameters = str(Path(get_package_share_directory("reference_fleet")) / "config" / "fleet.yaml")
    return LaunchDescription(
        [
            Node(package="reference_fleet", executable="coordinator", name="coordinator", parameters=[parameters]),
            Node(package="reference_fleet", executable="robot", name="robot_1", parameters=[parameters]),
            Node(package="reference_fleet", executable="robot", name="robot_2", parameters=[parameters]),
            Node(package="reference_fleet", executable="robot", name="robot_3", parameters=[parameters]),
        ]
    )
