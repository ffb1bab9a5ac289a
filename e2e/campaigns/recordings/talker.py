"""A talker with rclpy for the campaign of the recorder: numbered strings of one size at a steady rate. Prints each number after it was sent.

python -m campaigns.recordings.talker TOPIC PERIOD_S BYTES
"""

import os
import sys
import time
from random import Random

import rclpy
from std_msgs.msg import String


def talk(topic: str, period_s: float, size_bytes: int) -> None:
    """Publishes until the program is ended."""
    rclpy.init(args=[])
    node = rclpy.create_node("recorded_talker")
    publisher, number = node.create_publisher(String, topic, 100), 0
    due_s = time.monotonic()
    while rclpy.ok():
        padding = Random(number).randbytes(size_bytes // 2).hex()  # little to compress
        publisher.publish(String(data=f"{number}:{padding}"))
        os.write(1, b"%d\n" % number)
        number += 1
        due_s += period_s
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    talk(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
