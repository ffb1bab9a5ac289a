"""Programs of real ROS 2 (rclpy) for one topic: the talker is silent while a file is there.

python3 -m ros_nodes.chatter talker TOPIC     # ten messages per second
python3 -m ros_nodes.chatter listener TOPIC   # prints what it hears, one line each
python3 -m ros_nodes.chatter topics SECONDS   # what `ros2 topic list --no-daemon --spin-time SECONDS` prints
"""

import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

SILENCE: Final = Path("/tmp/silence")  # noqa: S108 - within the container
PERIOD_S: Final = 0.1


def main(role: str, argument: str) -> None:
    """Ends at SIGTERM by rclpy's own handler: one in Python does not run while rclpy waits for a message."""
    rclpy.init()
    with suppress(ExternalShutdownException):
        take_role(role, argument)


def take_role(role: str, argument: str) -> None:
    """Runs the node of this role until it has done its work or rclpy shuts down."""
    node = rclpy.create_node(f"chatter_{role}")
    if role == "topics":
        list_topics(node, float(argument))
    elif role == "listener":
        node.create_subscription(String, argument, lambda message: print("heard", message.data, flush=True), 10)
        rclpy.spin(node)
    else:
        talk(node, argument)


def talk(node: Node, topic: str) -> None:
    """Publishes numbers until the program is to end."""
    publisher, number = node.create_publisher(String, topic, 10), 0
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=0.0)
        if not SILENCE.exists():
            number += 1
            publisher.publish(String(data=str(number)))
        time.sleep(PERIOD_S)


def list_topics(node: Node, seconds: float) -> None:
    """Prints the topics that the node has heard of after so long."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
    for name, types in node.get_topic_names_and_types():
        print(name, *types)


if __name__ == "__main__":
    main(*sys.argv[1:3])
