"""The garbage collector walks an object once, and still finds what became garbage later."""

import gc
import weakref
from collections.abc import Iterator

import pytest

from robotapp_scheduler.shell.process import memory_tuning


@pytest.fixture(autouse=True)
def python_as_before() -> Iterator[None]:
    thresholds = gc.get_threshold()
    yield
    memory_tuning.released()
    gc.set_threshold(*thresholds)
    gc.freeze()  # as conftest.py left it


class Knot:
    """Refers to itself: only the collector finds it."""

    def __init__(self) -> None:
        self.me = self


def test_what_survived_a_lot_is_not_walked_again() -> None:
    memory_tuning.filled()
    frozen = gc.get_freeze_count()
    kept = [[number] for number in range(memory_tuning.LOT * 2)]
    assert gc.get_freeze_count() > frozen + memory_tuning.LOT // 2
    assert gc.get_count()[1:] == (0, 0)
    assert len(kept) == memory_tuning.LOT * 2


def test_a_cycle_that_was_set_aside_is_found_by_the_thorough_look() -> None:
    memory_tuning.filled()
    knot = Knot()
    seen = weakref.ref(knot)
    gc.collect(0)
    del knot
    gc.collect(0)
    assert seen() is not None
    memory_tuning.thorough()
    assert seen() is None


def test_a_process_that_goes_on_gets_python_s_own_ways_back() -> None:
    memory_tuning.filling()
    memory_tuning.filled()
    memory_tuning.filled()
    memory_tuning.released()
    assert gc.get_threshold() == memory_tuning.DEFAULTS
    assert gc.get_freeze_count() == 0
    assert not [each for each in gc.callbacks if getattr(each, "__module__", "") == memory_tuning.__name__]
