// A robot with a differential drive and a lidar in a world of walls, which stops when commands stay away.

#include <cmath>
#include <stdexcept>
#include <iostream>
#include <limits>
#include <vector>

#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

#include "world.hpp"

namespace {

constexpr double kStepS = 0.1;

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

class Robot {
 public:
  Robot()
      : params_("~"),
        world_(params_.param("start", std::vector<double>{1, 1, 0}), params_.param("walls", std::vector<double>{})),
        range_max_(params_.param("range_max", 6.0)),
        beams_(params_.param("beams", 180)),
        stop_after_s_(params_.param("stop_after_s", 0.5)) {
    odometry_ = node_.advertise<nav_msgs::Odometry>("odom", 10);
    scans_ = node_.advertise<sensor_msgs::LaserScan>("scan", 1);
    commands_ = node_.subscribe("cmd_vel", 10, &Robot::onCommand, this, ros::TransportHints().tcpNoDelay());
    stepping_ = node_.createWallTimer(ros::WallDuration(kStepS), &Robot::step, this);
  }

 private:
  void onCommand(const geometry_msgs::Twist& command) {
    command_ = command;
    commanded_s_ = now();
    is_stopped_ = false;
  }

  void step(const ros::WallTimerEvent&) {
    if (!is_stopped_ && now() - commanded_s_ > stop_after_s_) {
      command_ = geometry_msgs::Twist();
      is_stopped_ = true;
      std::cout << "no commands any more: stopped" << std::endl;
    }
    if (!world_.drive(command_.linear.x, command_.angular.z, kStepS) && !has_collided_) {
      has_collided_ = true;
      std::cout << "collided" << std::endl;
    }
    publishOdometry();
    publishScan();
  }

  void publishOdometry() {
    nav_msgs::Odometry odometry;
    odometry.header.stamp = ros::Time::now();
    odometry.header.frame_id = "odom";
    odometry.child_frame_id = "base_link";
    odometry.pose.pose.position.x = world_.x;
    odometry.pose.pose.position.y = world_.y;
    odometry.pose.pose.orientation.z = std::sin(world_.heading / 2);
    odometry.pose.pose.orientation.w = std::cos(world_.heading / 2);
    odometry.twist.twist = command_;
    odometry_.publish(odometry);
  }

  void publishScan() {
    sensor_msgs::LaserScan scan;
    scan.header.stamp = ros::Time::now();
    scan.header.frame_id = "base_link";
    scan.angle_increment = 2 * M_PI / beams_;
    scan.angle_max = scan.angle_increment * (beams_ - 1);
    scan.scan_time = kStepS;
    scan.range_max = range_max_;
    scan.ranges = world_.scan(beams_, range_max_);
    scans_.publish(scan);
  }

  ros::NodeHandle node_, params_;
  World world_;
  double range_max_;
  int beams_;
  double stop_after_s_;
  geometry_msgs::Twist command_;
  double commanded_s_ = -std::numeric_limits<double>::infinity();
  bool is_stopped_ = true, has_collided_ = false;
  ros::Publisher odometry_, scans_;
  ros::Subscriber commands_;
  ros::WallTimer stepping_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "robot");
  try {
    Robot node;
    ros::spin();
  } catch (const std::invalid_argument& error) {
    ROS_FATAL("parameters of the robot: %s", error.what());
    return 2;
  }
}
