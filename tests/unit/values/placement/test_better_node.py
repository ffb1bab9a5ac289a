"""The annotation by which the scheduler proposes a node to the operator."""

import json
import math
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.placement.better_node import BetterNode, edge_to, is_gain, parse_better_node, topic_of
from robotapp_api.values.quantities.duration import LONGEST_US

GOOD = BetterNode("edge-2", "/odom to driver", 61_000.0, 8_000.0, datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))


def test_what_is_written_is_read_again() -> None:
    assert (
        GOOD.text()
        == '{"node": "edge-2", "edge": "/odom to driver", "before": "61ms", "after": "8ms", "expires": "2026-01-02T03:04:05Z"}'
    )
    assert parse_better_node(GOOD.text()) == GOOD


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("node", ""),
        ("node", 7),
        ("node", "\ud800"),
        ("node", "edge-2\n"),
        ("node", "edge 2, but it is forbidden"),
        ("node", "a" * 254),
        ("edge", None),
        ("before", "soon"),
        ("after", None),
        ("expires", "2026-01-02T03:04:05"),
        ("expires", 1),
    ],
)
def test_what_is_of_another_form_is_refused_with_the_form(field: str, value: object) -> None:
    with pytest.raises(ValueError, match="is not of the form"):
        parse_better_node(json.dumps(json.loads(GOOD.text()) | {field: value}))


def test_no_answer_at_all_is_written_as_the_longest_time() -> None:
    assert parse_better_node(GOOD._replace(before_us=math.inf).text()).before_us == LONGEST_US


@pytest.mark.parametrize(
    ("before_us", "after_us", "expected"),
    [(30.0, 18.0, True), (30.0, 18.1, False), (22.0, 17.7, False), (22.0, 17.6, True), (math.inf, 18.0, True)],
)
def test_a_move_is_worth_it_with_a_tenth_of_the_budget_left_and_a_fifth_gained(
    before_us: float, after_us: float, expected: bool
) -> None:
    assert is_gain(before_us=before_us, after_us=after_us, budget_us=20.0) is expected


def test_an_edge_is_named_as_one_of_its_ends_sees_it() -> None:
    assert edge_to(topic_of("Topic", "/odom"), "driver") == "/odom to driver"
    assert edge_to(topic_of("Service", "/plan"), "@robot") == "service /plan to @robot"


@given(st.one_of(st.text(), st.sampled_from(["[" * 1000, "[" * 5000, "null", "1", "{}"])))
def test_no_text_is_a_crash(text: str) -> None:
    with pytest.raises(ValueError, match="is not of the form"):
        parse_better_node(text)
