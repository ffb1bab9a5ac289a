"""Counts readings where they arrive, and notices when they stay away."""


class Arrivals:
    """Times are seconds of one clock."""

    def __init__(self, silent_after_s, now_s):
        self._silent_after_s = silent_after_s
        self._arrived_s = now_s
        self._is_silent = False
        self._count = 0
        self._celsius = None

    def take(self, celsius, now_s):
        """Takes a reading. Returns a sentence if it ends a silence, else ""."""
        silent_s, was_silent = now_s - self._arrived_s, self._is_silent
        self._arrived_s, self._is_silent = now_s, False
        self._count += 1
        self._celsius = celsius
        return f"readings are back after {silent_s:.1f} s" if was_silent else ""

    def check(self, now_s):
        """Returns a sentence if a silence has just become too long, else ""."""
        if self._is_silent or now_s - self._arrived_s <= self._silent_after_s:
            return ""
        self._is_silent = True
        return f"no readings for {self._silent_after_s:g} s"

    def summarize(self):
        return f"{self._count} readings" + (f", the last {self._celsius:.2f} degrees" if self._count else "")
