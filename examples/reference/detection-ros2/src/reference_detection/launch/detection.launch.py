"""Both nodes on one machine, with the parameters of config/detection.yaml."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    parameters = str(Path(get_package_share_directory("reference_detection")) / "config" / "detection.yaml")
    return LaunchDescription(
        [
            Node(package="reference_detection", executable="camera", name="camera", parameters=[parameters]),
            Node(package="reference_detection", executable="detector", name="detector", parameters=[parameters]),
        ]
    )
