"""Drives as commanded, answers every command with its state, and stops when commands stay away."""

import math
import time

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from reference_teleop.drive import Drive

CONTROL_PERIOD_S = 0.05


class Robot(Node):
    def __init__(self):
        super().__init__("robot")
        self._drive = Drive(
            max_speed=self.declare_parameter("max_speed", 0.5).value,
            max_turn=self.declare_parameter("max_turn", 1.0).value,
            stop_after_s=self.declare_parameter("stop_after_s", 0.5).value,
        )
        self._states = self.create_publisher(Odometry, "robot_state", 10)
        self.create_subscription(TwistStamped, "cmd_vel", self._on_command, 10)
        self.create_timer(CONTROL_PERIOD_S, self._control)

    def _on_command(self, command):
        self._drive.command(command.twist.linear.x, command.twist.angular.z, time.monotonic())
        self._publish(command.header.stamp)

    def _control(self):
        if self._drive.move(time.monotonic()):
            self.get_logger().warning("no commands any more: stopped")
            self._publish(self.get_clock().now().to_msg())

    def _publish(self, stamp):
        state = Odometry()
        state.header.stamp = stamp
        state.header.frame_id = "odom"
        state.child_frame_id = "base_link"
        state.pose.pose.position.x = self._drive.x
        state.pose.pose.position.y = self._drive.y
        state.pose.pose.orientation.z = math.sin(self._drive.heading / 2)
        state.pose.pose.orientation.w = math.cos(self._drive.heading / 2)
        state.twist.twist.linear.x = self._drive.speed
        state.twist.twist.angular.z = self._drive.turn
        self._states.publish(state)


def main():
    rclpy.init()
    try:
        rclpy.spin(Robot())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
