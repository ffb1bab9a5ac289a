// A differential drive that stops by itself when nobody commands it any more.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

// Pose in metres and radians, speeds in m/s and rad/s. Times are seconds of one clock.
class Drive {
 public:
  Drive(double max_speed, double max_turn, double stop_after_s)
      : max_speed_(max_speed), max_turn_(max_turn), stop_after_s_(stop_after_s) {}

  double x = 0, y = 0, heading = 0, speed = 0, turn = 0;

  // Takes a command, within the limits of the drive.
  void command(double wanted_speed, double wanted_turn, double now_s) {
    move(now_s);
    speed = std::clamp(wanted_speed, -max_speed_, max_speed_);
    turn = std::clamp(wanted_turn, -max_turn_, max_turn_);
    commanded_s_ = now_s;
  }

  // Drives on until now. Returns whether it stopped for want of commands.
  bool move(double now_s) {
    const double until_s = std::min(now_s, commanded_s_ + stop_after_s_);
    if (until_s > moved_s_) driveFor(until_s - moved_s_);
    moved_s_ = now_s;
    const bool is_stopping = (speed != 0 || turn != 0) && now_s - commanded_s_ > stop_after_s_;
    if (is_stopping) speed = turn = 0;
    return is_stopping;
  }

 private:
  void driveFor(double seconds) {
    heading = std::remainder(heading + turn * seconds, 2 * M_PI);
    x += speed * seconds * std::cos(heading);
    y += speed * seconds * std::sin(heading);
  }

  double max_speed_, max_turn_, stop_after_s_;
  double commanded_s_ = -std::numeric_limits<double>::infinity();
  double moved_s_ = std::numeric_limits<double>::infinity();
};
