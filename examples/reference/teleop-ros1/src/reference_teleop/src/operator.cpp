// Sends velocity commands at a steady rate and measures how long each answer of the robot takes.

#include <fstream>
#include <iomanip>
#include <iostream>

#include <geometry_msgs/TwistStamped.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>

#include "round_trips.hpp"

namespace {

constexpr double kSummaryPeriodS = 5.0;

double now() { return ros::SteadyTime::now().toSec(); }

}  // namespace

// An answer carries the stamp of its command, so that clocks of two machines are never compared.
class Operator {
 public:
  Operator() : params_("~"), trips_(params_.param("deadline_ms", 50.0)) {
    params_.param("speed", speed_, 0.3);
    params_.param("turn", turn_, 0.2);
    const auto path = params_.param<std::string>("csv", "");
    if (!path.empty()) {
      csv_.open(path);
      csv_ << "sent_s,rtt_ms" << std::endl;
    }
    commands_ = node_.advertise<geometry_msgs::TwistStamped>("cmd_vel", 10);
    states_ = node_.subscribe("robot_state", 10, &Operator::onState, this, ros::TransportHints().tcpNoDelay());
    sending_ = node_.createWallTimer(ros::WallDuration(1 / params_.param("rate_hz", 20.0)), &Operator::send, this);
    summary_timer_ = node_.createWallTimer(ros::WallDuration(kSummaryPeriodS), &Operator::logSummary, this);
  }

  ~Operator() { std::cout << trips_.summary() << std::endl; }

 private:
  void send(const ros::WallTimerEvent&) {
    if (commands_.getNumSubscribers() == 0) return;  // there is no robot yet
    geometry_msgs::TwistStamped command;
    command.header.stamp = ros::Time::now();
    command.twist.linear.x = speed_;
    command.twist.angular.z = turn_;
    trips_.send(command.header.stamp, now());
    commands_.publish(command);
    for (const auto& stamp : trips_.giveUp(now())) write(stamp) << std::endl;
  }

  void onState(const nav_msgs::Odometry& state) {
    if (const auto rtt_ms = trips_.answer(state.header.stamp, now())) write(state.header.stamp) << *rtt_ms << std::endl;
  }

  // Begins a row. One without a time is a command that was never answered.
  std::ostream& write(const ros::Time& stamp) {
    return csv_ << stamp.sec << '.' << std::setfill('0') << std::setw(9) << stamp.nsec << ',';
  }

  void logSummary(const ros::WallTimerEvent&) { std::cout << trips_.summary() << std::endl; }

  ros::NodeHandle node_, params_;
  RoundTrips trips_;
  double speed_, turn_;
  std::ofstream csv_;
  ros::Publisher commands_;
  ros::Subscriber states_;
  ros::WallTimer sending_, summary_timer_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "operator");
  Operator node;
  ros::spin();
}
