// A world of walls with one robot in it, which has a differential drive and a lidar.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

class World {
 public:
  double x, y, heading;

  // `start` is x, y and heading. `walls` has the middle, the length along x and the width along y of each wall.
  World(const std::vector<double>& start, const std::vector<double>& walls) {
    if (start.size() != 3) throw std::invalid_argument("start needs three numbers: x, y and heading");
    if (walls.size() % 4 != 0) throw std::invalid_argument("walls need four numbers each: x, y, length and width");
    x = start[0], y = start[1], heading = start[2];
    for (std::size_t first = 0; first < walls.size(); first += 4) {
      const double half_length = walls[first + 2] / 2, half_width = walls[first + 3] / 2;
      walls_.push_back({walls[first] - half_length, walls[first] + half_length, walls[first + 1] - half_width,
                        walls[first + 1] + half_width});
    }
  }

  // Drives for some seconds within the limits of the drive. Returns false, and stays, where a wall is in the way.
  bool drive(double speed, double turn, double seconds) {
    heading = std::remainder(heading + std::clamp(turn, -kMaxTurn, kMaxTurn) * seconds, 2 * M_PI);
    const double way = std::clamp(speed, -kMaxSpeed, kMaxSpeed) * seconds;
    const double next_x = x + way * std::cos(heading), next_y = y + way * std::sin(heading);
    for (const Wall& wall : walls_) {
      const double to_x = std::clamp(next_x, wall.left, wall.right), to_y = std::clamp(next_y, wall.low, wall.high);
      if (std::hypot(next_x - to_x, next_y - to_y) < kRadius) return false;
    }
    x = next_x, y = next_y;
    return true;
  }

  // Returns what a lidar measures all around, beginning at the heading; range_max where nothing is.
  std::vector<float> scan(int beams, double range_max) const {
    std::vector<float> ranges(beams, range_max);
    for (int beam = 0; beam < beams; ++beam) {
      const double angle = heading + beam * 2 * M_PI / beams;
      for (const Wall& wall : walls_) {
        ranges[beam] = std::min<float>(ranges[beam], distanceTo(wall, std::cos(angle), std::sin(angle)));
      }
    }
    return ranges;
  }

 private:
  struct Wall {
    double left, right, low, high;
  };
  static constexpr double kRadius = 0.2, kMaxSpeed = 0.8, kMaxTurn = 1.5;

  // Returns how far a ray goes until it meets the wall; infinity if it does not.
  double distanceTo(const Wall& wall, double across, double up) const {
    double enters = 0, leaves = std::numeric_limits<double>::infinity();
    clip(wall.left - x, wall.right - x, across, enters, leaves);
    clip(wall.low - y, wall.high - y, up, enters, leaves);
    return enters <= leaves ? enters : std::numeric_limits<double>::infinity();
  }

  // Keeps of a ray the part that is between two parallel sides.
  static void clip(double from, double to, double direction, double& enters, double& leaves) {
    if (direction == 0) {
      if (from > 0 || to < 0) leaves = -1;  // beside the wall, all along
      return;
    }
    enters = std::max(enters, std::min(from / direction, to / direction));
    leaves = std::min(leaves, std::max(from / direction, to / direction));
  }

  std::vector<Wall> walls_;
};
