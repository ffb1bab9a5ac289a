"""Publishes the readings of the sensor that the container was given."""

import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import Temperature

from reference_sensor.sensor import Sensor

POLL_PERIOD_S = 0.02


class Driver(Node):
    def __init__(self):
        super().__init__("driver")
        device = self.declare_parameter("device", "/dev/sensor").value
        self._sensor = Sensor(device, self.declare_parameter("baud_rate", 115200).value)
        self._frame = self.declare_parameter("frame_id", "sensor").value
        self._temperatures = self.create_publisher(Temperature, "temperature", 10)
        self.create_timer(POLL_PERIOD_S, self._poll)

    def _poll(self):
        for celsius in self._sensor.poll(time.monotonic()):
            message = Temperature(temperature=celsius)
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self._frame
            self._temperatures.publish(message)


def main():
    rclpy.init()
    try:
        rclpy.spin(Driver())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
