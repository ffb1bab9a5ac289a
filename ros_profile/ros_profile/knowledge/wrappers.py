"""Classes of ROS libraries whose constructors make publishers and subscriptions of the node."""

from dataclasses import dataclass

from ros_profile.model.endpoints import Role


@dataclass(frozen=True, slots=True)
class Made:
    """`topic` with `{}` for the name that is given to the constructor."""

    role: Role
    topic: str
    type: str


_FOOTPRINT, _COSTMAP = "geometry_msgs/msg/PolygonStamped", "nav2_msgs/msg/Costmap"
WRAPPERS: dict[str, tuple[Made, ...]] = {
    "TwistPublisher": (Made(Role.PUBLISHER, "{}", "geometry_msgs/msg/Twist"),),
    "TwistSubscriber": (Made(Role.SUBSCRIPTION, "{}", "geometry_msgs/msg/Twist"),),
    "FootprintSubscriber": (Made(Role.SUBSCRIPTION, "{}", _FOOTPRINT),),
    "CostmapSubscriber": (Made(Role.SUBSCRIPTION, "{}", _COSTMAP),),
    "nav2_costmap_2d::Costmap2DROS": (
        Made(Role.PUBLISHER, "{}/costmap_raw", _COSTMAP),
        Made(Role.PUBLISHER, "{}/published_footprint", _FOOTPRINT),
    ),
    "costmap_2d::Costmap2DROS": (Made(Role.PUBLISHER, "~/{}/footprint", _FOOTPRINT),),
}
"""By class name, with its namespace where two generations differ."""
