"""Both nodes on one machine, with the parameters of config/sensor.yaml."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    parameters = str(Path(get_package_share_directory("reference_sensor")) / "config" / "sensor.yaml")
    return LaunchDescription(
        [
            Node(package="reference_sensor", executable="driver", name="driver", parameters=[parameters]),
            Node(package="reference_sensor", executable="listener", name="listener", parameters=[parameters]),
        ]
    )
