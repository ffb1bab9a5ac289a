"""What a spec leaves to its distribution: ROS version, middleware and discovery."""

from typing import Final

from robotapp_api.checks.middleware import ZENOH, resolve_mode
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.distros import DISTROS, ros_version

NONE: Final = "None"
"""Discovery of an app of one pod: what the middleware does by itself."""
DEFAULT_RMW: Final = "rmw_fastrtps_cpp"


def ros_version_of(spec: RobotAppSpec) -> int:
    """1 or 2: as written, else the distribution's, else 2."""
    return ros_version(spec.ros.version, spec.ros.distro)


def rmw_of(spec: RobotAppSpec) -> str:
    """Middleware as written or the distribution's default; "" for ROS 1."""
    if ros_version_of(spec) == 1:
        return ""
    if spec.ros2 and spec.ros2.rmw:
        return spec.ros2.rmw
    known = DISTROS.get(spec.ros.distro)
    return known.rmw if known and known.rmw else DEFAULT_RMW


def discovery_of(spec: RobotAppSpec) -> str:
    """Discovery mode with `Auto` decided; "" for ROS 1.

    An app of one pod has nobody to find, so `Auto` gives it no servers and no peers (NONE). Zenoh needs its router even
    between the processes of one pod.
    """
    if ros_version_of(spec) == 1:
        return ""
    mode = spec.ros2.discovery.mode if spec.ros2 else "Auto"
    rmw = rmw_of(spec)
    has_others = bool(spec.ros2 and (spec.ros2.share_with or spec.ros2.external))
    pods = sum(component.replicas for component in spec.components)
    if mode == "Auto" and pods == 1 and not has_others and rmw not in ZENOH:
        return NONE
    return resolve_mode(mode, rmw)
