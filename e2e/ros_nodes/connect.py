"""Takes the middleware that the environment names, and ends the program when its pod is to end."""

import os
import signal
import sys

from ros_nodes.bus import Bus, Role


def connect(role: Role) -> Bus:
    """By the environment the operator of RobotApp gave: a ROS 1 master, else DDS."""
    if "ROS_MASTER_URI" in os.environ:
        from ros_nodes.rospy_bus import RospyBus

        return RospyBus(role)
    from ros_nodes.dds_bus import DdsBus

    return DdsBus(role, domain=int(os.environ["ROS_DOMAIN_ID"]))


def end_on_request() -> None:
    """End at SIGTERM, as programs of ROS do. The first process of a container has no default for it: the pod would end after 30 s only."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
