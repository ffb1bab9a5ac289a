"""Words of the API, equal to those of robotapp_api, which the profiler does not need (a test compares them)."""

from typing import Final

API_VERSION: Final = "robotics.io/v1alpha1"
SCHEDULER_PREFIX: Final = "scheduler.robotics.io/"
"""Prefix of the annotations of pods."""
MAX_APP_NAME: Final = 40
MAX_COMPONENTS: Final = 64
MAX_EDGES: Final = 256
ROS1_DISTROS: Final = frozenset(
    {
        *("boxturtle", "cturtle", "diamondback", "electric", "fuerte", "groovy", "hydro", "indigo", "jade"),
        *("kinetic", "lunar", "melodic", "noetic"),
    }
)
