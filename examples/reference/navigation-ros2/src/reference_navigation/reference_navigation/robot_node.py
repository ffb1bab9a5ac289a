"""A robot with a differential drive and a lidar in the world of ir-sim, which stops when commands stay away."""

import math
import time

import irsim
import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

STEP_S = 0.1
"""That of the world's file."""


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self._world = irsim.make(self.declare_parameter("world", "world.yaml").value, disable_all_plot=True)
        self._stop_after_s = self.declare_parameter("stop_after_s", 0.5).value
        self._speed = self._turn = 0.0
        self._commanded_s = -math.inf
        self._is_stopped = True
        self._has_collided = False
        self._odometry = self.create_publisher(Odometry, "odom", 10)
        self._scans = self.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.create_subscription(Twist, "cmd_vel", self._on_command, 10)
        self.create_timer(STEP_S, self._step)

    def _on_command(self, command):
        self._speed, self._turn = command.linear.x, command.angular.z
        self._commanded_s = time.monotonic()
        self._is_stopped = False

    def _step(self):
        if not self._is_stopped and time.monotonic() - self._commanded_s > self._stop_after_s:
            self._speed, self._turn, self._is_stopped = 0.0, 0.0, True
            print("no commands any more: stopped", flush=True)
        self._world.step(np.array([[self._speed], [self._turn]]))
        if self._world.robot.collision and not self._has_collided:
            self._has_collided = True
            print("collided", flush=True)
        self._publish(self.get_clock().now().to_msg())

    def _publish(self, stamp):
        x, y, heading = (float(value) for value in self._world.get_robot_state().ravel()[:3])
        odometry = Odometry()
        odometry.header.stamp, odometry.header.frame_id, odometry.child_frame_id = stamp, "odom", "base_link"
        odometry.pose.pose.position.x, odometry.pose.pose.position.y = x, y
        odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w = (
            math.sin(heading / 2),
            math.cos(heading / 2),
        )
        odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = self._speed, self._turn
        self._odometry.publish(odometry)
        lidar = self._world.get_lidar_scan()
        scan = LaserScan()
        scan.header.stamp, scan.header.frame_id = stamp, "base_link"
        scan.angle_min, scan.angle_max = float(lidar["angle_min"]), float(lidar["angle_max"])
        scan.angle_increment, scan.scan_time = float(lidar["angle_increment"]), STEP_S
        scan.range_min, scan.range_max = float(lidar["range_min"]), float(lidar["range_max"])
        scan.ranges = [float(distance) for distance in lidar["ranges"]]
        self._scans.publish(scan)


def main():
    rclpy.init()
    try:
        rclpy.spin(Robot())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
