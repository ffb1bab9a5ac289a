"""Finds signs in the pictures of a camera, and counts by the camera's truth how many of them it has found."""

import csv
import json
import time
from collections import OrderedDict
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from reference_detection.camera_node import write_signs
from reference_detection.detector import count_hits, detect, load
from reference_detection.scene import Sign

SUMMARY_PERIOD_S = 5.0
REMEMBERED = 20


class Detector(Node):
    """A picture that comes while another one is worked on replaces those that wait: late detections help nobody."""

    def __init__(self):
        super().__init__("detector")
        self._model = load(self.declare_parameter("model", "model.pkl").value)
        path = self.declare_parameter("csv", "").value
        self._file = Path(path).open("w", newline="") if path else None
        self._rows = csv.writer(self._file) if self._file else None
        if self._rows:
            self._rows.writerow(["stamp", "detect_ms", "signs", "detected", "hits"])
        self._truths = OrderedDict()
        self._frames = self._signs = self._hits = self._false = 0
        self._work_s = 0.0
        self._detections = self.create_publisher(String, "detections", 10)
        self.create_subscription(String, "truth", self._on_truth, 10)
        latest = qos_profile_sensor_data
        latest.depth = 1
        self.create_subscription(Image, "image_raw", self._on_image, latest)
        self.create_timer(SUMMARY_PERIOD_S, self._log_summary)

    def close(self):
        self._log_summary()
        if self._file:
            self._file.close()

    def _on_truth(self, message):
        truth = json.loads(message.data)
        self._truths[tuple(truth["stamp"])] = [Sign(**sign) for sign in truth["signs"]]
        if len(self._truths) > REMEMBERED:
            self._truths.popitem(last=False)

    def _on_image(self, image):
        began_s = time.monotonic()
        picture = np.frombuffer(bytes(image.data), np.uint8).reshape(image.height, image.step)[:, : image.width]
        signs = detect(self._model, picture)
        work_s = time.monotonic() - began_s
        self._detections.publish(String(data=write_signs(image.header.stamp, signs)))
        self._count(image.header.stamp, signs, work_s)

    def _count(self, stamp, signs, work_s):
        truth = self._truths.pop((stamp.sec, stamp.nanosec), None)
        if truth is None:
            return  # a camera without truth
        hits = count_hits(truth, signs)
        self._frames += 1
        self._signs += len(truth)
        self._hits += hits
        self._false += len(signs) - hits
        self._work_s += work_s
        if self._rows:
            seconds = f"{stamp.sec}.{stamp.nanosec:09d}"
            self._rows.writerow([seconds, f"{work_s * 1000:.1f}", len(truth), len(signs), hits])
            self._file.flush()

    def _log_summary(self):
        if self._frames:
            # print, not the logger: at the end rclpy has shut down already.
            print(
                f"{self._frames} pictures, recall {self._hits / self._signs:.3f}, {self._false} false, "
                f"{self._work_s / self._frames * 1000:.1f} ms each",
                flush=True,
            )


def main():
    rclpy.init()
    detector = Detector()
    try:
        rclpy.spin(detector)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        detector.close()


if __name__ == "__main__":
    main()
