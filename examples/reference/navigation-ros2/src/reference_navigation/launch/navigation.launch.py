"""Both nodes on one machine, with the parameters of config/navigation.yaml."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    parameters = str(Path(get_package_share_directory("reference_navigation")) / "config" / "navigation.yaml")
    return LaunchDescription(
        [
            Node(package="reference_navigation", executable="planner", name="planner", parameters=[parameters]),
            Node(package="reference_navigation", executable="robot", name="robot", parameters=[parameters]),
        ]
    )
