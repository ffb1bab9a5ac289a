"""What the bench of the console judges, and the fleet it writes down."""

import re
from collections.abc import AsyncIterator

import pytest

from campaigns.console.console import Figures, list_problems
from campaigns.console.made_fleet import HALLS, make_fleet, name_app
from campaigns.console.visitors import OpenPage

GOOD: Figures = {
    "first_screen_s": 0.6,
    "update_median_s": 0.2,
    "rss_mb": 130,
    "rest_core_share": 0.03,
    "neighbour_worst_page_s": 0.4,
    "neighbour_pages_refused": 0,
    "api_load_of_2_pages": {"requests": 22},
    "api_load_of_10_pages": {"requests": 22},
}


def test_good_figures_are_no_problem() -> None:
    assert list_problems(GOOD) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"first_screen_s": 1.2}, "first screen after 1.2 s"),
        ({"update_median_s": 0.4}, "updates after 0.4 s"),
        ({"rss_mb": 201}, "201 MB"),
        ({"rest_core_share": 0.06}, "6.0% of a core at rest"),
        ({"neighbour_worst_page_s": 1.5}, "a page took 1.5 s"),
        ({"neighbour_pages_refused": 1}, "beside a busy user"),
        ({"api_load_of_10_pages": {"requests": 23}}, "10 open pages cost 23 requests, 2 cost 22"),
    ],
)
def test_each_limit_that_is_missed_is_named(change: Figures, words: str) -> None:
    (problem,) = list_problems(GOOD | change)
    assert words in problem


def test_the_fleet_has_a_node_per_robot_and_edge_servers_in_every_hall() -> None:
    fleet = make_fleet(30)
    assert len(fleet.topology) == 30 + HALLS + 1
    assert len({name_app(robot) for robot in fleet.robots}) == 30


async def stream() -> AsyncIterator[bytes]:
    for line in (b"data: <p>one</p>\n", b"\n", b": still here\n", b"\n", b"data: <p>\n", b"data: two</p>\n", b"\n"):
        yield line


async def test_an_open_page_has_the_latest_fragment_of_its_stream() -> None:
    page = OpenPage()
    await page.read(stream())
    assert page.content == "<p>\ntwo</p>"
    assert page.fragments == 2
    assert await page.wait_for(re.compile("two"), within_s=1) < 1
