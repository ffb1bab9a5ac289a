"""A talker of zenoh-ros2-sdk, silent while a file is there: python3 -m ros_nodes.zenoh.talker TOPIC."""

import os
import sys
import time

from zenoh_ros2_sdk import ROS2Publisher

from ros_nodes.connect import end_on_request
from ros_nodes.zenoh.sessions import open_session


def main(topic: str) -> None:
    """Publishes numbers, ten per second. The library opens its session once and fails without a router, hence the first one."""
    end_on_request()
    open_session("client").close()
    # A client accepts nobody, but the library's own configuration opens a port on `localhost`.
    os.environ["ZENOH_CONFIG_OVERRIDE"] += ";listen/endpoints=[]"
    publisher = ROS2Publisher(topic, "std_msgs/msg/String", "string data\n", node_name="talker")
    number = 0
    while True:
        if not os.path.exists("/tmp/silence"):  # noqa: PTH110, S108 - within the container
            number += 1
            publisher.publish(data=str(number))
        time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1])
