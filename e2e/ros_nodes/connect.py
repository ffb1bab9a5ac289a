"""Takes the middleware that the environment names."""

import os

from ros_nodes.bus import Bus, Role


def connect(role: Role) -> Bus:
    """By the environment the operator of RobotApp gave: a ROS 1 master, else DDS."""
    if "ROS_MASTER_URI" in os.environ:
        from ros_nodes.rospy_bus import RospyBus

        return RospyBus(role)
    from ros_nodes.dds_bus import DdsBus

    return DdsBus(role, domain=int(os.environ["ROS_DOMAIN_ID"]))
