"""So much and no more, per key: buckets that fill with time."""

from collections.abc import Callable, Hashable
from typing import Final

MOST_KEYS: Final = 4096
"""Buckets kept; the one that was used longest ago goes, and would be nearly full anyway."""


class Buckets:
    """Each key may take `burst` at once and `per_s` a second for ever."""

    def __init__(self, *, per_s: float, burst: float, clock: Callable[[], float]) -> None:
        self._per_s = per_s
        self._burst = burst
        self._clock = clock
        self._left: dict[Hashable, tuple[float, float]] = {}
        """Per key: how much was left, and when."""

    def __repr__(self) -> str:
        return f"<Buckets {self._per_s:g}/s, {len(self._left)} keys>"

    def wait_s(self, key: Hashable) -> float:
        """Take one and give 0, or take none and say in how many seconds there is one."""
        now_s = self._clock()
        left, at_s = self._left.pop(key, (self._burst, now_s))
        left = min(self._burst, left + (now_s - at_s) * self._per_s)
        wait_s = 0.0 if left >= 1 else (1 - left) / self._per_s
        self._left[key] = (left - 1 if not wait_s else left, now_s)
        if len(self._left) > MOST_KEYS:
            del self._left[next(iter(self._left))]
        return wait_s
