// Counts readings where they arrive, and notices when they stay away.
#pragma once

#include <iomanip>
#include <sstream>
#include <string>

// Times are seconds of one clock.
class Arrivals {
 public:
  Arrivals(double silent_after_s, double now_s) : silent_after_s_(silent_after_s), arrived_s_(now_s) {}

  // Takes a reading. Returns a sentence if it ends a silence, else "".
  std::string take(double celsius, double now_s) {
    const double silent_s = now_s - arrived_s_;
    const bool was_silent = is_silent_;
    arrived_s_ = now_s;
    is_silent_ = false;
    celsius_ = celsius;
    ++count_;
    if (!was_silent) return "";
    std::ostringstream text;
    text << "readings are back after " << std::fixed << std::setprecision(1) << silent_s << " s";
    return text.str();
  }

  // Returns a sentence if a silence has just become too long, else "".
  std::string check(double now_s) {
    if (is_silent_ || now_s - arrived_s_ <= silent_after_s_) return "";
    is_silent_ = true;
    std::ostringstream text;
    text << "no readings for " << silent_after_s_ << " s";
    return text.str();
  }

  std::string summarize() const {
    std::ostringstream text;
    text << count_ << " readings";
    if (count_ > 0) text << ", the last " << std::fixed << std::setprecision(2) << celsius_ << " degrees";
    return text.str();
  }

 private:
  double silent_after_s_;
  double arrived_s_;
  bool is_silent_ = false;
  std::size_t count_ = 0;
  double celsius_ = 0;
};
