// Drives as commanded, answers every command with its state, and stops when commands stay away.

#include <cmath>

#include <geometry_msgs/TwistStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>

#include "drive.hpp"

namespace {

constexpr double kControlPeriodS = 0.05;

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

class Robot {
 public:
  Robot()
      : params_("~"),
        drive_(params_.param("max_speed", 0.5), params_.param("max_turn", 1.0), params_.param("stop_after_s", 0.5)) {
    states_ = node_.advertise<nav_msgs::Odometry>("robot_state", 10);
    commands_ = node_.subscribe("cmd_vel", 10, &Robot::onCommand, this, ros::TransportHints().tcpNoDelay());
    controlling_ = node_.createWallTimer(ros::WallDuration(kControlPeriodS), &Robot::control, this);
  }

 private:
  void onCommand(const geometry_msgs::TwistStamped& command) {
    drive_.command(command.twist.linear.x, command.twist.angular.z, now());
    publish(command.header.stamp);
  }

  void control(const ros::WallTimerEvent&) {
    if (!drive_.move(now())) return;
    ROS_WARN("no commands any more: stopped");
    publish(ros::Time::now());
  }

  void publish(const ros::Time& stamp) {
    nav_msgs::Odometry state;
    state.header.stamp = stamp;
    state.header.frame_id = "odom";
    state.child_frame_id = "base_link";
    state.pose.pose.position.x = drive_.x;
    state.pose.pose.position.y = drive_.y;
    state.pose.pose.orientation.z = std::sin(drive_.heading / 2);
    state.pose.pose.orientation.w = std::cos(drive_.heading / 2);
    state.twist.twist.linear.x = drive_.speed;
    state.twist.twist.angular.z = drive_.turn;
    states_.publish(state);
  }

  ros::NodeHandle node_, params_;
  Drive drive_;
  ros::Publisher states_;
  ros::Subscriber commands_;
  ros::WallTimer controlling_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "robot");
  Robot node;
  ros::spin();
}
