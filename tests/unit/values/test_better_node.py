"""The annotation by which the scheduler proposes a node to the operator."""

import json
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.better_node import BetterNode, parse_better_node

GOOD = BetterNode("edge-2", 61_000.0, 8_000.0, datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC))


def test_what_is_written_is_read_again() -> None:
    assert GOOD.text() == '{"node": "edge-2", "before": "61ms", "after": "8ms", "expires": "2026-01-02T03:04:05Z"}'
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
        ("before", "soon"),
        ("after", None),
        ("expires", "2026-01-02T03:04:05"),
        ("expires", 1),
    ],
)
def test_what_is_of_another_form_is_refused_with_the_form(field: str, value: object) -> None:
    with pytest.raises(ValueError, match="is not of the form"):
        parse_better_node(json.dumps(json.loads(GOOD.text()) | {field: value}))


@given(st.one_of(st.text(), st.sampled_from(["[" * 1000, "[" * 5000, "null", "1", "{}"])))
def test_no_text_is_a_crash(text: str) -> None:
    with pytest.raises(ValueError, match="is not of the form"):
        parse_better_node(text)
