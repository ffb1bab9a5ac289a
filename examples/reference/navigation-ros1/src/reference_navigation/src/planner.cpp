// Makes a map of the robot's scans, finds a path over it, and steers the robot to its goal, all off board.

#include <cmath>
#include <iomanip>
#include <iostream>
#include <limits>
#include <optional>
#include <tuple>
#include <vector>

#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/LaserScan.h>

#include "grid.hpp"

namespace {

constexpr double kPlanPeriodS = 1.0;
constexpr double kSteerPeriodS = 0.1;
constexpr double kFreshS = 0.5;
constexpr double kReachedM = 0.25;

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

class Planner {
 public:
  Planner()
      : params_("~"),
        goal_{params_.param("goal_x", 9.0), params_.param("goal_y", 9.0)},
        grid_(params_.param("size", 10.0)),
        max_speed_(params_.param("max_speed", 0.6)) {
    commands_ = node_.advertise<geometry_msgs::Twist>("cmd_vel", 10);
    const auto hints = ros::TransportHints().tcpNoDelay();
    odometry_ = node_.subscribe("odom", 10, &Planner::onOdometry, this, hints);
    scans_ = node_.subscribe("scan", 1, &Planner::onScan, this, hints);
    planning_ = node_.createWallTimer(ros::WallDuration(kPlanPeriodS), &Planner::plan, this);
    steering_ = node_.createWallTimer(ros::WallDuration(kSteerPeriodS), &Planner::steer, this);
  }

 private:
  void onOdometry(const nav_msgs::Odometry& odometry) {
    const auto& position = odometry.pose.pose.position;
    const auto& turned = odometry.pose.pose.orientation;
    if (pose_) length_m_ += std::hypot(position.x - pose_->x, position.y - pose_->y);
    pose_ = Pose{position.x, position.y, 2 * std::atan2(turned.z, turned.w)};
    heard_s_ = now();
  }

  void onScan(const sensor_msgs::LaserScan& scan) {
    if (pose_) grid_.addScan(*pose_, scan.angle_min, scan.angle_increment, scan.ranges, scan.range_max);
  }

  void plan(const ros::WallTimerEvent&) {
    if (!pose_ || is_there_) return;
    const double began_s = now();
    path_ = grid_.findPath({pose_->x, pose_->y}, goal_);
    std::cout << "a path of " << path_.size() << " points in " << (now() - began_s) * 1000 << " ms" << std::endl;
  }

  // Commands the robot only while it is heard: the robot itself stops when commands end.
  void steer(const ros::WallTimerEvent&) {
    if (is_there_ || path_.empty() || now() - heard_s_ > kFreshS) return;
    if (!began_s_) began_s_ = now();
    geometry_msgs::Twist command;
    if (distance(pose_->x, pose_->y, goal_) <= kReachedM) {
      is_there_ = true;
      std::cout << "reached the goal after " << now() - *began_s_ << " s and " << length_m_ << " m" << std::endl;
    } else {
      std::tie(command.linear.x, command.angular.z) = follow(*pose_, path_, max_speed_);
    }
    commands_.publish(command);
  }

  ros::NodeHandle node_, params_;
  Point goal_;
  Grid grid_;
  double max_speed_;
  std::optional<Pose> pose_;
  std::optional<double> began_s_;
  double heard_s_ = -std::numeric_limits<double>::infinity();
  double length_m_ = 0;
  bool is_there_ = false;
  std::vector<Point> path_;
  ros::Publisher commands_;
  ros::Subscriber odometry_, scans_;
  ros::WallTimer planning_, steering_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "planner");
  std::cout << std::fixed << std::setprecision(1);
  Planner node;
  ros::spin();
}
