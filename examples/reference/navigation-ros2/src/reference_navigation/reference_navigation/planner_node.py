"""Makes a map of the robot's scans, finds a path over it, and steers the robot to its goal, all off board."""

import math
import time

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from reference_navigation.grid import Grid, follow

PLAN_PERIOD_S = 1.0
STEER_PERIOD_S = 0.1
FRESH_S = 0.5
REACHED_M = 0.25


class Planner(Node):
    def __init__(self):
        super().__init__("planner")
        self._goal = (self.declare_parameter("goal_x", 9.0).value, self.declare_parameter("goal_y", 9.0).value)
        self._grid = Grid(self.declare_parameter("size", 10.0).value)
        self._max_speed = self.declare_parameter("max_speed", 0.6).value
        self._pose = None
        self._heard_s = -math.inf
        self._began_s = None
        self._path = []
        self._length = 0.0
        self._is_there = False
        self._commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Odometry, "odom", self._on_odometry, 10)
        self.create_subscription(LaserScan, "scan", self._on_scan, qos_profile_sensor_data)
        self.create_timer(PLAN_PERIOD_S, self._plan)
        self.create_timer(STEER_PERIOD_S, self._steer)

    def _on_odometry(self, odometry):
        position, turned = odometry.pose.pose.position, odometry.pose.pose.orientation
        if self._pose:
            self._length += math.dist(self._pose[:2], (position.x, position.y))
        self._pose = position.x, position.y, 2 * math.atan2(turned.z, turned.w)
        self._heard_s = time.monotonic()

    def _on_scan(self, scan):
        if self._pose is None:
            return
        x, y, heading = self._pose
        ranges = np.array(scan.ranges)
        angles = heading + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        self._grid.add_scan(x, y, angles, ranges, scan.range_max)

    def _plan(self):
        if self._pose is None or self._is_there:
            return
        began_s = time.monotonic()
        self._path = self._grid.find_path(self._pose[:2], self._goal)
        work_ms = (time.monotonic() - began_s) * 1000
        print(f"a path of {len(self._path)} points in {work_ms:.0f} ms", flush=True)

    def _steer(self):
        """Commands the robot only while it is heard: the robot itself stops when commands end."""
        if self._is_there or not self._path or time.monotonic() - self._heard_s > FRESH_S:
            return
        self._began_s = self._began_s or time.monotonic()
        command = Twist()
        if math.dist(self._pose[:2], self._goal) <= REACHED_M:
            self._is_there = True
            seconds = time.monotonic() - self._began_s
            print(f"reached the goal after {seconds:.1f} s and {self._length:.1f} m", flush=True)
        else:
            command.linear.x, command.angular.z = follow(self._pose, self._path, self._max_speed)
        self._commands.publish(command)


def main():
    rclpy.init()
    try:
        rclpy.spin(Planner())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
