"""What a spec leaves to its distribution: ROS version, middleware and discovery."""

from collections.abc import Sequence
from typing import Final

from robotapp_api.checks.middleware import ZENOH, resolve_mode
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.distros import DISTROS, NO_DISTRO, NO_ROS, WITHOUT_ROS, ros_version

NONE: Final = "None"
"""Discovery of an app with ROS in one pod: what the middleware does by itself."""
DEFAULT_RMW: Final = "rmw_fastrtps_cpp"


def ros_version_of(spec: RobotAppSpec) -> int:
    """1 or 2: as written, else the distribution's, else 2; NO_ROS where no component uses ROS."""
    return ros_version(spec.ros.version, spec.ros.distro) if ros_components(spec) else NO_ROS


def uses_ros(component: Component, distro: str) -> bool:
    """Whether the component is a ROS program, in an app of this distribution."""
    return component.ros != WITHOUT_ROS and distro != NO_DISTRO


def ros_components(spec: RobotAppSpec) -> Sequence[Component]:
    """The components that use ROS, in the order of the spec."""
    return tuple(component for component in spec.components if uses_ros(component, spec.ros.distro))


def rmw_of(spec: RobotAppSpec) -> str:
    """Middleware as written or the distribution's default; "" for ROS 1 and without ROS."""
    if ros_version_of(spec) != 2:
        return ""
    if spec.ros2 and spec.ros2.rmw:
        return spec.ros2.rmw
    known = DISTROS.get(spec.ros.distro)
    return known.rmw if known and known.rmw else DEFAULT_RMW


def discovery_of(spec: RobotAppSpec) -> str:
    """Discovery mode with `Auto` decided; "" for ROS 1 and without ROS.

    An app with ROS in one pod has nobody to find, so `Auto` gives it no servers and no peers (NONE), and where it shares its domain
    with other apps (isolation Discovery) it stays within the pod. Zenoh needs its router even between the processes of one pod. A suspended component counts as one pod: the others must not restart because of it.
    """
    if ros_version_of(spec) != 2:
        return ""
    mode = spec.ros2.discovery.mode if spec.ros2 else "Auto"
    rmw = rmw_of(spec)
    has_others = bool(spec.ros2 and (spec.ros2.share_with or spec.ros2.external))
    pods = sum(max(component.replicas, 1) for component in ros_components(spec))
    if mode == "Auto" and pods == 1 and not has_others and rmw not in ZENOH:
        return "Localhost" if spec.ros2 and spec.ros2.isolation == "Discovery" else NONE
    return resolve_mode(mode, rmw)
