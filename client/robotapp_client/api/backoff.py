"""Exponential back-off with jitter; the source of randomness is a parameter."""

import random
from collections.abc import Callable


class Backoff:
    """Delays base·factorⁿ up to `cap_s`, each shortened by up to `jitter` of itself so that clients do not march in step.

    >>> Backoff(base_s=1, cap_s=5, jitter=0).next_s()
    1.0
    """

    __slots__ = ("_attempt", "_base_s", "_cap_s", "_factor", "_jitter", "_uniform")

    def __init__(
        self,
        *,
        base_s: float = 0.2,
        cap_s: float = 30.0,
        factor: float = 2.0,
        jitter: float = 0.5,
        uniform: Callable[[], float] = random.random,
    ) -> None:
        self._base_s = base_s
        self._cap_s = cap_s
        self._factor = factor
        self._jitter = jitter
        self._uniform = uniform
        self._attempt = 0

    def __repr__(self) -> str:
        return f"<Backoff attempt {self._attempt}, {self._base_s}..{self._cap_s} s>"

    @property
    def attempt(self) -> int:
        """How many delays were handed out since the last reset."""
        return self._attempt

    def reset(self) -> None:
        self._attempt = 0

    def next_s(self, *, at_least_s: float | None = None) -> float:
        """The next delay in seconds, never below `at_least_s` (a server's Retry-After)."""
        # The exponent is bounded: 2.0**1024 overflows after a weekend without an API server.
        delay_s = min(self._cap_s, self._base_s * self._factor ** min(self._attempt, 60))
        self._attempt += 1
        delay_s *= 1 - self._jitter * self._uniform()
        return max(delay_s, at_least_s or 0.0)
