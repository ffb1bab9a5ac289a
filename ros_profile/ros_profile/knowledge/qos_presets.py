"""The QoS presets of rmw (`qos_profiles.h`, `rmw/qos_profiles`), which rclcpp and rclpy give other names."""

from dataclasses import replace
from typing import Final

from ros_profile.model.endpoints import Qos

PRESETS: Final = {
    preset.profile: preset
    for preset in (
        Qos("default", "reliable", "volatile", "keep_last", depth=10),
        Qos("sensor_data", "best_effort", "volatile", "keep_last", depth=5),
        Qos("parameters", "reliable", "volatile", "keep_last", depth=1000),
        Qos("parameter_events", "reliable", "volatile", "keep_last", depth=1000),
        Qos("services_default", "reliable", "volatile", "keep_last", depth=10),
        Qos("system_default"),
        Qos("best_available", history="keep_last", depth=10),
    )
}
"""By name. Empty fields and a depth of -1 are left to the middleware, or follow the other end."""


def preset(name: str) -> Qos:
    """The preset of that name; one that is not known states its name alone."""
    return PRESETS.get(name, Qos(name))


def with_depth(depth: int) -> Qos:
    """What a bare depth means to rclcpp and rclpy: the default preset with that depth, -1 where none is stated. A queue size
    of ROS 1 comes to the same.
    """
    return replace(PRESETS["default"], depth=depth)
