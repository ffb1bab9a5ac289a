"""Sends generated pictures as a camera does, and what is in them for whoever wants to check a detector."""

import json

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from reference_detection.scene import generate_frame


class Camera(Node):
    def __init__(self):
        super().__init__("camera")
        self._random = np.random.default_rng(self.declare_parameter("seed", 7).value)
        self._images = self.create_publisher(Image, "image_raw", qos_profile_sensor_data)
        has_truth = self.declare_parameter("truth", True).value
        self._truth = self.create_publisher(String, "truth", 10) if has_truth else None
        self.create_timer(1 / self.declare_parameter("rate_hz", 2.0).value, self._send)

    def _send(self):
        picture, signs = generate_frame(self._random)
        image = Image()
        image.header.stamp = self.get_clock().now().to_msg()
        image.header.frame_id = "camera"
        image.height, image.width = picture.shape
        image.encoding = "mono8"
        image.step = image.width
        image.data = picture.tobytes()
        if self._truth:
            # Sent first, so that it is there when the detections come.
            self._truth.publish(String(data=write_signs(image.header.stamp, signs)))
        self._images.publish(image)


def write_signs(stamp, signs):
    """Returns the signs of one picture as JSON."""
    listed = [{"kind": sign.kind, "x": float(sign.x), "y": float(sign.y)} for sign in signs]
    return json.dumps({"stamp": [stamp.sec, stamp.nanosec], "signs": listed})


def main():
    rclpy.init()
    try:
        rclpy.spin(Camera())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
