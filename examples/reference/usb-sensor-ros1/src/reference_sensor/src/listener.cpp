// Counts the readings that arrive, and prints when they stay away and come back.

#include <iostream>

#include <ros/ros.h>
#include <sensor_msgs/Temperature.h>

#include "arrivals.hpp"

namespace {

constexpr double kCheckPeriodS = 0.1;
constexpr double kSummaryPeriodS = 5.0;

double now() { return ros::SteadyTime::now().toSec(); }

void print(const std::string& sentence) {
  if (!sentence.empty()) std::cout << sentence << std::endl;
}

}  // namespace

class Listener {
 public:
  Listener() : params_("~"), arrivals_(params_.param("silent_after_s", 2.0), now()) {
    temperatures_ = node_.subscribe("temperature", 10, &Listener::onTemperature, this);
    check_timer_ = node_.createWallTimer(ros::WallDuration(kCheckPeriodS), &Listener::check, this);
    summary_timer_ = node_.createWallTimer(ros::WallDuration(kSummaryPeriodS), &Listener::logSummary, this);
  }

  ~Listener() { print(arrivals_.summarize()); }

 private:
  void onTemperature(const sensor_msgs::Temperature& message) { print(arrivals_.take(message.temperature, now())); }

  void check(const ros::WallTimerEvent&) { print(arrivals_.check(now())); }

  void logSummary(const ros::WallTimerEvent&) { print(arrivals_.summarize()); }

  ros::NodeHandle node_, params_;
  Arrivals arrivals_;
  ros::Subscriber temperatures_;
  ros::WallTimer check_timer_, summary_timer_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "listener");
  Listener node;
  ros::spin();
}
