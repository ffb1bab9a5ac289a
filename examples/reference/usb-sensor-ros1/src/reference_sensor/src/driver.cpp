// Publishes the readings of the sensor that the container was given.

#include <ros/ros.h>
#include <sensor_msgs/Temperature.h>

#include "sensor.hpp"

constexpr double kPollPeriodS = 0.02;

class Driver {
 public:
  Driver()
      : params_("~"),
        sensor_(params_.param<std::string>("device", "/dev/sensor"), params_.param("baud_rate", 115200)),
        frame_(params_.param<std::string>("frame_id", "sensor")) {
    temperatures_ = node_.advertise<sensor_msgs::Temperature>("temperature", 10);
    poll_timer_ = node_.createWallTimer(ros::WallDuration(kPollPeriodS), &Driver::poll, this);
  }

 private:
  void poll(const ros::WallTimerEvent&) {
    for (const double celsius : sensor_.poll(ros::SteadyTime::now().toSec())) {
      sensor_msgs::Temperature message;
      message.header.stamp = ros::Time::now();
      message.header.frame_id = frame_;
      message.temperature = celsius;
      temperatures_.publish(message);
    }
  }

  ros::NodeHandle node_, params_;
  Sensor sensor_;
  std::string frame_;
  ros::Publisher temperatures_;
  ros::WallTimer poll_timer_;
};

int main(int argc, char** argv) {
  ros::init(argc, argv, "driver");
  try {
    Driver node;
    ros::spin();
  } catch (const std::invalid_argument& error) {
    std::cerr << error.what() << std::endl;
    return 2;
  }
}
