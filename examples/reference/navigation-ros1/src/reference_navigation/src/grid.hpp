// An occupancy grid made of laser scans, the shortest safe path over it, and how to follow that path.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

// Metres and radians in the frame of the world.
struct Point {
  double x = 0, y = 0;
};

struct Pose {
  double x = 0, y = 0, heading = 0;
};

inline double distance(double x, double y, const Point& point) { return std::hypot(point.x - x, point.y - y); }

// A square from (0, 0) to (size, size). A cell is occupied where more rays ended than passed.
class Grid {
 public:
  explicit Grid(double size, double safe_distance = 0.35)
      : cells_(std::lround(size / kCell)),
        safe_cells_(std::lround(std::ceil(safe_distance / kCell))),
        votes_(cells_ * cells_) {}

  // Takes a scan from a pose, whose first angle is relative to the pose.
  void addScan(const Pose& pose, double angle_min, double angle_increment, const std::vector<float>& ranges,
               double range_max) {
    std::vector<char> passed(votes_.size()), hit(votes_.size());
    double angle = pose.heading + angle_min;
    for (const float range : ranges) {
      const double across = std::cos(angle), up = std::sin(angle);
      const double passed_m = std::min<double>(range, range_max) - kCell;
      for (double step = 0; step < passed_m; step += kCell / 2) {
        mark(passed, pose.x + across * step, pose.y + up * step);
      }
      if (range < range_max - kCell) mark(hit, pose.x + across * range, pose.y + up * range);
      angle += angle_increment;
    }
    // Each cell is voted for once per scan, however many rays meet it.
    for (std::size_t cell = 0; cell < votes_.size(); ++cell) {
      votes_[cell] = std::clamp(votes_[cell] + kMiss * passed[cell] + kHit * hit[cell], kLeast, kMost);
    }
  }

  // Returns points from start to goal by A*, or none where no path is known.
  std::vector<Point> findPath(const Point& start, const Point& goal) const {
    const int first = cellOf(start), last = cellOf(goal);
    std::vector<char> unsafe = findUnsafeCells();
    unsafe[last] = false;
    // A robot that is too near to a wall has to get away from it.
    forEachNeighbour(first, [&](int cell, double) { unsafe[cell] = false; });
    std::vector<double> cost(votes_.size(), std::numeric_limits<double>::infinity());
    std::vector<int> came_from(votes_.size(), -1);
    std::priority_queue<std::pair<double, int>, std::vector<std::pair<double, int>>, std::greater<>> queue;
    cost[first] = 0;
    queue.emplace(0, first);
    while (!queue.empty()) {
      const int cell = queue.top().second;
      queue.pop();
      if (cell == last) return pointsTo(last, came_from);
      forEachNeighbour(cell, [&](int next, double length) {
        if (unsafe[next] || cost[cell] + length >= cost[next]) return;
        cost[next] = cost[cell] + length;
        came_from[next] = cell;
        queue.emplace(cost[next] + cellsBetween(next, last), next);
      });
    }
    return {};
  }

 private:
  static constexpr double kCell = 0.1;  // side of a cell in metres
  static constexpr int kHit = 3, kMiss = -1, kLeast = -4, kMost = 12;

  void mark(std::vector<char>& marks, double x, double y) const {
    const int column = std::floor(x / kCell), row = std::floor(y / kCell);
    if (isInside(row, column)) marks[row * cells_ + column] = 1;
  }

  bool isInside(int row, int column) const { return row >= 0 && row < cells_ && column >= 0 && column < cells_; }

  // Returns where the middle of the robot must not be. What no ray has reached yet is taken as free.
  std::vector<char> findUnsafeCells() const {
    std::vector<char> unsafe(votes_.size());
    for (int row = 0; row < cells_; ++row) {
      for (int column = 0; column < cells_; ++column) {
        const int to_edge = std::min({row, column, cells_ - 1 - row, cells_ - 1 - column});
        if (to_edge < safe_cells_) unsafe[row * cells_ + column] = 1;
        if (votes_[row * cells_ + column] > 0) markAround(unsafe, row, column);
      }
    }
    return unsafe;
  }

  void markAround(std::vector<char>& marks, int row, int column) const {
    for (int up = -safe_cells_; up <= safe_cells_; ++up) {
      for (int across = -safe_cells_; across <= safe_cells_; ++across) {
        const bool is_near = std::hypot(up, across) <= safe_cells_;
        if (is_near && isInside(row + up, column + across)) marks[(row + up) * cells_ + column + across] = 1;
      }
    }
  }

  // Calls with each of up to eight neighbours and the way to it in cells.
  template <typename Visit>
  void forEachNeighbour(int cell, const Visit& visit) const {
    const int row = cell / cells_, column = cell % cells_;
    for (int up = -1; up <= 1; ++up) {
      for (int across = -1; across <= 1; ++across) {
        if ((up == 0 && across == 0) || !isInside(row + up, column + across)) continue;
        visit((row + up) * cells_ + column + across, std::hypot(up, across));
      }
    }
  }

  double cellsBetween(int one, int other) const {
    return std::hypot(one / cells_ - other / cells_, one % cells_ - other % cells_);
  }

  int cellOf(const Point& point) const {
    const int row = std::floor(point.y / kCell), column = std::floor(point.x / kCell);
    return std::clamp(row, 0, cells_ - 1) * cells_ + std::clamp(column, 0, cells_ - 1);
  }

  std::vector<Point> pointsTo(int cell, const std::vector<int>& came_from) const {
    std::vector<Point> points;
    for (; cell >= 0; cell = came_from[cell]) {
      points.push_back({(cell % cells_ + 0.5) * kCell, (cell / cells_ + 0.5) * kCell});
    }
    std::reverse(points.begin(), points.end());
    return points;
  }

  int cells_, safe_cells_;
  std::vector<int> votes_;
};

// Returns speed and turn towards the first point that is `ahead` metres away: slower the more it lies aside.
inline std::pair<double, double> follow(const Pose& pose, const std::vector<Point>& path, double max_speed,
                                        double ahead = 0.5) {
  const auto far = std::find_if(path.begin(), path.end(),
                                [&](const Point& point) { return distance(pose.x, pose.y, point) >= ahead; });
  const Point target = far == path.end() ? path.back() : *far;
  const double aside = std::remainder(std::atan2(target.y - pose.y, target.x - pose.x) - pose.heading, 2 * M_PI);
  const double near_goal = std::min(1.0, distance(pose.x, pose.y, path.back()) / ahead + 0.2);
  const double speed = max_speed * std::pow(std::max(std::cos(aside), 0.0), 2) * near_goal;
  return {speed, std::clamp(2 * aside, -1.5, 1.5)};
}
