"""Decisions of a case: from a seed, or from hypothesis.

Everything is built on `integer`, and the first of several options is always the plainest one: so a case shrinks by
making numbers smaller, whoever drew them.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from random import Random
from typing import TypeVar

from hypothesis import strategies as st

T = TypeVar("T")


class Choices(ABC):
    @abstractmethod
    def integer(self, low: int, high: int) -> int:
        """Both ends included."""

    def pick(self, options: Sequence[T]) -> T:
        return options[self.integer(0, len(options) - 1)]

    def chance(self, percent: int) -> bool:
        """True in about `percent` of 100 cases; False is the plain outcome."""
        return self.integer(0, 99) >= 100 - percent

    def some(self, options: Sequence[T], *, least: int = 0, most: int | None = None) -> list[T]:
        """Different options in the given order, `least` to `most` of them."""
        left = list(options)
        count = self.integer(least, min(len(left), len(left) if most is None else most))
        chosen = [left.pop(self.integer(0, len(left) - 1)) for _ in range(count)]
        return [option for option in options if option in chosen]


class SeededChoices(Choices):
    """A pure function of the seed."""

    def __init__(self, seed: str) -> None:
        self._random = Random(seed)

    def integer(self, low: int, high: int) -> int:
        return self._random.randint(low, high)


class DrawnChoices(Choices):
    """Hypothesis decides."""

    def __init__(self, draw: st.DrawFn) -> None:
        self._draw = draw

    def integer(self, low: int, high: int) -> int:
        return self._draw(st.integers(low, high))
