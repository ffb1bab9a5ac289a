"""The garbage collector walks an object once, and still finds what became garbage later."""

import gc
import weakref
from collections.abc import Iterator

import pytest

from robotapp_scheduler.shell.process import garbage


@pytest.fixture(autouse=True)
def python_as_before() -> Iterator[None]:
    thresholds = gc.get_threshold()
    yield
    garbage.released()
    gc.set_threshold(*thresholds)
    gc.freeze()  # as tests/conftest.py left it


class Knot:
    """Refers to itself: only the collector finds it."""

    def __init__(self) -> None:
        self.me = self


def test_what_survived_a_lot_is_not_walked_again() -> None:
    garbage.filled()
    frozen = gc.get_freeze_count()
    kept = [[number] for number in range(garbage.LOT * 2)]
    assert gc.get_freeze_count() > frozen + garbage.LOT // 2
    assert gc.get_count()[1:] == (0, 0)
    assert len(kept) == garbage.LOT * 2


def test_a_cycle_that_was_set_aside_is_found_by_the_thorough_look() -> None:
    garbage.filled()
    knot = Knot()
    seen = weakref.ref(knot)
    gc.collect(0)
    del knot
    gc.collect(0)
    assert seen() is not None
    garbage.thorough()
    assert seen() is None


def test_a_process_that_goes_on_gets_python_s_own_ways_back() -> None:
    garbage.filling()
    garbage.filled()
    garbage.filled()
    garbage.released()
    assert gc.get_threshold() == garbage.DEFAULTS
    assert gc.get_freeze_count() == 0
    assert not [each for each in gc.callbacks if getattr(each, "__module__", "") == garbage.__name__]
