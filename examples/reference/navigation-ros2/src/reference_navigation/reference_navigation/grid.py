"""An occupancy grid made of laser scans, and the shortest safe path over it."""

import heapq
import math

import numpy as np

CELL = 0.1
"""Side of a cell in metres."""
_HIT, _MISS = 3, -1
_LEAST, _MOST = -4, 12
_NEIGHBOURS = [(dx, dy, math.hypot(dx, dy)) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]


class Grid:
    """A square from (0, 0) to (size, size) in metres. A cell is occupied where more rays ended than passed."""

    def __init__(self, size, safe_distance=0.35):
        self.cells = round(size / CELL)
        self._votes = np.zeros((self.cells, self.cells), int)
        self._safe_cells = math.ceil(safe_distance / CELL)

    def add_scan(self, x, y, angles, ranges, range_max):
        """Takes a scan from a pose; angles are those of the world."""
        reach = np.minimum(ranges, range_max)
        steps = np.arange(0, range_max, CELL / 2)
        is_passed = steps[None, :] < (reach - CELL)[:, None]
        xs = x + np.cos(angles)[:, None] * steps[None, :]
        ys = y + np.sin(angles)[:, None] * steps[None, :]
        self._vote(xs[is_passed], ys[is_passed], _MISS)
        hits = ranges < range_max - CELL
        self._vote(x + np.cos(angles[hits]) * ranges[hits], y + np.sin(angles[hits]) * ranges[hits], _HIT)
        np.clip(self._votes, _LEAST, _MOST, out=self._votes)

    def _vote(self, xs, ys, weight):
        """Each cell is voted for once per scan, however many rays meet it."""
        columns, rows = (xs / CELL).astype(int), (ys / CELL).astype(int)
        is_inside = (columns >= 0) & (columns < self.cells) & (rows >= 0) & (rows < self.cells)
        voted_cells = np.unique(rows[is_inside] * self.cells + columns[is_inside])
        self._votes.flat[voted_cells] += weight

    def find_unsafe_cells(self):
        """Returns the cells where the middle of the robot must not be. What no ray has reached yet is taken as free."""
        occupied_cells = self._votes > 0
        unsafe_cells = occupied_cells.copy()
        reach = self._safe_cells
        for down in range(-reach, reach + 1):
            for right in range(-reach, reach + 1):
                if math.hypot(down, right) <= reach:
                    unsafe_cells |= _shift(occupied_cells, down, right)
        for edge in (np.s_[:reach], np.s_[-reach:], np.s_[:, :reach], np.s_[:, -reach:]):
            unsafe_cells[edge] = True
        return unsafe_cells

    def find_path(self, start, goal):
        """Returns points in metres from start to goal by A*, or nothing where no path is known."""
        unsafe_cells = self.find_unsafe_cells()
        first, last = self._cell_of(start), self._cell_of(goal)
        unsafe_cells[last] = False
        unsafe_cells[self._around(first)] = False  # a robot that is too near to a wall has to get away from it
        came_from, cost, queue = {first: None}, {first: 0.0}, [(0.0, first)]
        while queue:
            _, cell = heapq.heappop(queue)
            if cell == last:
                return _points(came_from, last)
            for dx, dy, length in _NEIGHBOURS:
                after = cell[0] + dy, cell[1] + dx
                if not (0 <= after[0] < self.cells and 0 <= after[1] < self.cells) or unsafe_cells[after]:
                    continue
                total = cost[cell] + length
                if total < cost.get(after, math.inf):
                    cost[after], came_from[after] = total, cell
                    heapq.heappush(queue, (total + math.dist(after, last), after))
        return []

    def _cell_of(self, point):
        row, column = int(point[1] / CELL), int(point[0] / CELL)
        return min(max(row, 0), self.cells - 1), min(max(column, 0), self.cells - 1)

    def _around(self, cell):
        return tuple(slice(max(index - 1, 0), index + 2) for index in cell)


def _shift(mask, down, right):
    """Returns the mask moved by whole cells, with nothing coming in over the edge."""
    shifted_mask = np.zeros_like(mask)
    rows, columns = mask.shape
    shifted_mask[max(down, 0) : rows + min(down, 0), max(right, 0) : columns + min(right, 0)] = mask[
        max(-down, 0) : rows + min(-down, 0), max(-right, 0) : columns + min(-right, 0)
    ]
    return shifted_mask


def _points(came_from, cell):
    points = []
    while cell is not None:
        points.append(((cell[1] + 0.5) * CELL, (cell[0] + 0.5) * CELL))
        cell = came_from[cell]
    return points[::-1]


def follow(pose, path, max_speed, ahead=0.5):
    """Returns speed and turn towards the first point of the path that is `ahead` metres away: slower the more it lies aside."""
    x, y, heading = pose
    target = next((point for point in path if math.dist(point, (x, y)) >= ahead), path[-1])
    aside = math.remainder(math.atan2(target[1] - y, target[0] - x) - heading, math.tau)
    speed = max_speed * max(math.cos(aside), 0.0) ** 2 * min(1.0, math.dist(path[-1], (x, y)) / ahead + 0.2)
    return speed, max(-1.5, min(1.5, 2.0 * aside))
