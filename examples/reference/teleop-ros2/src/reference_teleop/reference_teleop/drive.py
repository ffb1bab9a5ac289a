"""A differential drive that stops by itself when nobody commands it any more."""

import math


class Drive:
    """Pose in metres and radians, speeds in m/s and rad/s. Times are seconds of one clock."""

    def __init__(self, max_speed, max_turn, stop_after_s):
        self._max_speed = max_speed
        self._max_turn = max_turn
        self._stop_after_s = stop_after_s
        self._commanded_s = -math.inf
        self._moved_s = None
        self.x = self.y = self.heading = 0.0
        self.speed = self.turn = 0.0

    def command(self, speed, turn, now_s):
        """Takes a command, within the limits of the drive."""
        self.move(now_s)
        self.speed = max(-self._max_speed, min(self._max_speed, speed))
        self.turn = max(-self._max_turn, min(self._max_turn, turn))
        self._commanded_s = now_s

    def move(self, now_s):
        """Drives on until now. Returns whether it stopped for want of commands."""
        if self._moved_s is not None:
            until_s = min(now_s, self._commanded_s + self._stop_after_s)
            self._drive_for(max(until_s - self._moved_s, 0.0))
        self._moved_s = now_s
        is_stopping = (self.speed != 0.0 or self.turn != 0.0) and now_s - self._commanded_s > self._stop_after_s
        if is_stopping:
            self.speed = self.turn = 0.0
        return is_stopping

    def _drive_for(self, seconds):
        self.heading = math.remainder(self.heading + self.turn * seconds, math.tau)
        self.x += self.speed * seconds * math.cos(self.heading)
        self.y += self.speed * seconds * math.sin(self.heading)
