"""A listener by the stand-in of rclpy, which prints what it hears: python3 -m ros_nodes.zenoh.listener TOPIC."""

import sys

from ros_nodes.connect import end_on_request
from ros_nodes.zenoh import stand_in


def main(topic: str) -> None:
    """Prints a line per message until its pod is to end."""
    end_on_request()
    stand_in.init()
    node = stand_in.create_node("listener")
    string = stand_in.load_type("std_msgs/msg/String")
    node.create_subscription(
        string, topic, lambda data: print("heard", data, flush=True), stand_in.QoSProfile(depth=10)
    )
    while True:
        stand_in.spin_once(node, timeout_sec=1.0)


if __name__ == "__main__":
    main(sys.argv[1])
