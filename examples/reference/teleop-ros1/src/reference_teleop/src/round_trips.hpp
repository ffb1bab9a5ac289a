// Round trips of commands: which are on their way, how long the others took, and which came too late.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <ros/time.h>

// A command that is not answered within `given_up` deadlines counts as lost. Times are seconds of one clock.
class RoundTrips {
 public:
  explicit RoundTrips(double deadline_ms, double given_up = 20)
      : deadline_ms_(deadline_ms), lost_after_s_(given_up * deadline_ms / 1000) {}

  void send(const ros::Time& stamp, double now_s) {
    ++sent_;
    pending_[stamp] = now_s;
  }

  // Returns the round trip in ms, or nothing for a stamp that waits for no answer.
  std::optional<double> answer(const ros::Time& stamp, double now_s) {
    const auto command = pending_.find(stamp);
    if (command == pending_.end()) return std::nullopt;
    const double rtt_ms = (now_s - command->second) * 1000;
    pending_.erase(command);
    rtts_ms_.push_back(rtt_ms);
    late_ += rtt_ms > deadline_ms_;
    return rtt_ms;
  }

  // Returns the stamps of commands that are lost, and counts them as late.
  std::vector<ros::Time> giveUp(double now_s) {
    std::vector<ros::Time> lost;
    for (const auto& [stamp, sent_s] : pending_) {
      if (now_s - sent_s > lost_after_s_) lost.push_back(stamp);
    }
    for (const auto& stamp : lost) pending_.erase(stamp);
    late_ += lost.size();
    return lost;
  }

  // Returns the least round trip in ms that `share` percent do not exceed; NaN without any.
  double percentile(double share) const {
    if (rtts_ms_.empty()) return std::numeric_limits<double>::quiet_NaN();
    std::vector<double> ordered = rtts_ms_;
    const auto rank = std::max<long>(std::lround(std::ceil(ordered.size() * share / 100)) - 1, 0);
    std::nth_element(ordered.begin(), ordered.begin() + rank, ordered.end());
    return ordered[rank];
  }

  std::string summary() const {
    std::ostringstream text;
    text.setf(std::ios::fixed);
    text.precision(2);
    text << sent_ << " commands, " << rtts_ms_.size() << " answered, " << late_ << " late (over " << deadline_ms_
         << " ms or lost), p50 " << percentile(50) << " ms, p95 " << percentile(95) << " ms, p99 " << percentile(99)
         << " ms";
    return text.str();
  }

 private:
  double deadline_ms_;
  double lost_after_s_;
  std::map<ros::Time, double> pending_;
  std::vector<double> rtts_ms_;
  std::size_t sent_ = 0;
  std::size_t late_ = 0;
};
