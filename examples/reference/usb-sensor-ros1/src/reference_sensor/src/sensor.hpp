// A temperature sensor on a serial port, which is opened again after it was unplugged.
//
// The sensor sends a line per reading, framed as in NMEA 0183: `$T,21.43*52`. The two digits are the exclusive or of the
// bytes between `$` and `*`, so that a line that was cut off by a plug counts for nothing.
#pragma once

#include <cerrno>
#include <cstring>
#include <iostream>
#include <map>
#include <optional>
#include <regex>
#include <stdexcept>
#include <string>
#include <vector>

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

constexpr std::size_t kLongestLine = 80;
constexpr double kRetryS = 1.0;

inline int computeChecksum(const std::string& data) {
  unsigned char checksum = 0;
  for (const char byte : data) checksum ^= static_cast<unsigned char>(byte);
  return checksum;
}

// Returns degrees Celsius, or nothing for a line that is not whole.
inline std::optional<double> parseReading(const std::string& line) {
  static const std::regex whole(R"(\$(T,(-?[0-9]{1,4}(?:\.[0-9]{1,6})?))\*([0-9A-F]{2})\r?)");
  std::smatch match;
  // A regular expression of the standard library goes one call deeper per character: what is too long is not matched.
  if (line.size() > kLongestLine || !std::regex_match(line, match, whole)) return std::nullopt;
  if (computeChecksum(match[1]) != std::stoi(match[3], nullptr, 16)) return std::nullopt;
  return std::stod(match[2]);
}

// Returns the constant of termios for a rate such as 115200.
inline speed_t findSpeed(int baud_rate) {
  static const std::map<int, speed_t> speeds = {{9600, B9600}, {19200, B19200}, {57600, B57600}, {115200, B115200}};
  const auto speed = speeds.find(baud_rate);
  if (speed == speeds.end()) {
    throw std::invalid_argument("baud_rate " + std::to_string(baud_rate) +
                                " is not supported; write 9600, 19200, 57600 or 115200");
  }
  return speed->second;
}

// Opens a serial port for reading and drops what came before. Returns -1 and leaves the reason in errno.
inline int openPort(const std::string& path, speed_t speed) {
  const int port = open(path.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (port < 0) return -1;
  termios attributes;
  if (tcgetattr(port, &attributes) == 0) {
    cfmakeraw(&attributes);
    cfsetspeed(&attributes, speed);
    if (tcsetattr(port, TCSANOW, &attributes) == 0 && tcflush(port, TCIFLUSH) == 0) return port;
  }
  const int reason = errno;
  close(port);
  errno = reason;
  return -1;
}

// Polled by a timer of a node. Prints when the device comes and goes, once each; times are seconds of one clock.
class Sensor {
 public:
  Sensor(std::string path, int baud_rate) : path_(std::move(path)), speed_(findSpeed(baud_rate)) {}

  // Returns the readings since the last poll, in degrees Celsius; none while there is no device.
  std::vector<double> poll(double now_s) {
    std::vector<double> readings;
    if (port_ < 0 && !connect(now_s)) return readings;
    for (const auto& line : readLines()) {
      if (const auto reading = parseReading(line)) readings.push_back(*reading);
    }
    readings_ += readings.size();
    return readings;
  }

 private:
  bool connect(double now_s) {
    if (now_s < retry_at_s_) return false;
    retry_at_s_ = now_s + kRetryS;
    port_ = openPort(path_, speed_);
    if (port_ < 0) {
      const std::string reason = std::strerror(errno);
      if (reason != absence_) {
        std::cout << "no device at " << path_ << ": " << reason << "; tried again every " << kRetryS << " s" << std::endl;
      }
      absence_ = reason;
      return false;
    }
    absence_.clear();
    rest_.clear();
    readings_ = 0;
    std::cout << "connected to " << path_ << std::endl;
    return true;
  }

  std::vector<std::string> readLines() {
    char data[4096];
    const ssize_t size = read(port_, data, sizeof data);
    std::vector<std::string> lines;
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return lines;
    if (size <= 0) {
      disconnect();
      return lines;
    }
    rest_.append(data, static_cast<std::size_t>(size));
    for (auto end = rest_.find('\n'); end != std::string::npos; end = rest_.find('\n')) {
      lines.push_back(rest_.substr(0, end));
      rest_.erase(0, end + 1);
    }
    if (rest_.size() > kLongestLine) rest_.erase(0, rest_.size() - kLongestLine);
    return lines;
  }

  void disconnect() {
    // Closed at once: as long as somebody has it open, the kernel gives the device another number when it is back.
    close(port_);
    port_ = -1;
    std::cout << path_ << " was unplugged after " << readings_ << " readings" << std::endl;
  }

  std::string path_;
  speed_t speed_;
  int port_ = -1;
  double retry_at_s_ = 0;
  std::string absence_;
  std::string rest_;
  std::size_t readings_ = 0;
};
