"""The event loop rests under load while there is nothing to do, and only then."""

import asyncio

import pytest

from robotapp_scheduler.shell.process.response_batching import LEAST_S, MOST_S, TOGETHER, TURNS, ResponseBatching


class Course:
    """Answers that come at `per_s` while the loop rests, and as many as the test says while it turns."""

    def __init__(self, *, busy: bool = True, per_s: float = 0.0) -> None:
        self.busy = busy
        self.per_s = per_s
        self.came = 0.0
        self.rests: list[float] = []
        self.gathering = ResponseBatching(lambda: self.busy, lambda: int(self.came), rest=self._rest)

    def _rest(self, seconds: float) -> None:
        self.rests.append(seconds)
        self.came += self.per_s * seconds


async def turns(count: int) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


@pytest.mark.parametrize("per_s", [1300.0, 4000.0, 20_000.0])
async def test_a_rest_is_as_long_as_it_takes_some_answers_to_come(per_s: float) -> None:
    course = Course(per_s=per_s)
    course.gathering.begin()
    await turns(200)
    assert course.rests[-1] * per_s == pytest.approx(TOGETHER, rel=0.2)


@pytest.mark.parametrize(("per_s", "expected_s"), [(0.0, MOST_S), (1e6, LEAST_S)])
async def test_a_rest_is_never_longer_nor_shorter_than_is_good(per_s: float, expected_s: float) -> None:
    course = Course(per_s=per_s)
    course.gathering.begin()
    await turns(200)
    assert course.rests[-1] == expected_s


async def test_a_server_that_halts_once_makes_no_long_rest_of_a_short_one() -> None:
    course = Course(per_s=12_000.0)
    course.gathering.begin()
    await turns(200)
    course.per_s = 0.0
    before = len(course.rests)
    while len(course.rests) < before + 2:
        await turns(1)
    assert course.rests[-1] <= 2 * course.rests[before - 1]


async def test_while_answers_come_there_is_no_rest() -> None:
    course = Course()
    course.gathering.begin()
    for _ in range(100):
        course.came += 1
        await turns(TURNS - 1)
    assert course.rests == []
    await turns(TURNS + 2)
    assert course.rests


async def test_without_load_nothing_rests_and_it_begins_again_with_the_next() -> None:
    course = Course(busy=False)
    course.gathering.begin()
    await turns(50)
    assert course.rests == []
    assert repr(course.gathering) == "<Gathering, idle>"

    course.busy = True
    course.gathering.begin()
    await turns(50)
    assert course.rests
    assert "at a time" in repr(course.gathering)
    course.busy = False
    await turns(1)
    rests = len(course.rests)
    await turns(50)
    assert len(course.rests) == rests


async def test_it_turns_once_however_often_it_is_begun() -> None:
    once, often = Course(), Course()
    once.gathering.begin()
    for _ in range(10):
        often.gathering.begin()
    await turns(50)
    assert len(often.rests) == len(once.rests)
