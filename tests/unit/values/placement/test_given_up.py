"""The annotation by which the scheduler tells the operator what was given up for a place."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.placement.given_up import MAX_BYTES, MAX_EDGES, GivenUp, GivenUpEdge, parse_given_up

EDGE = GivenUpEdge("/image", "detector", 30_000, 42_000.0, "measured", ("edge-1", "edge-2"))
GOOD = GivenUp((EDGE,), "Robot", ("Edge",))
FORM = "is not what the scheduler writes"


def test_what_is_written_is_read_again() -> None:
    assert GOOD.text() == (
        '{"edges": [{"edge": "/image", "peer": "detector", "budget": "30ms", "time": "42ms", "source": "measured", '
        '"nodes": ["edge-1", "edge-2"]}], "tier": "Robot", "insteadOf": ["Edge"]}'
    )
    for found in (
        GOOD,
        GivenUp(),
        GivenUp((EDGE._replace(time_us=math.inf),)),
        GivenUp((), "Cloud", ("Robot", "Edge")),
    ):
        assert parse_given_up(found.text()) == found


def test_of_many_edges_the_worst_are_written_and_they_fit() -> None:
    names = ("n" * 253, "m" * 253)
    many = [
        EDGE._replace(edge="/" + "t" * 254, peer=f"c{i}", time_us=31_000.0 + 1000 * i, nodes=names) for i in range(64)
    ]
    text = GivenUp(tuple(many)).text()
    assert len(text) <= MAX_BYTES
    assert [each.peer for each in parse_given_up(text).edges] == [f"c{63 - i}" for i in range(MAX_EDGES)]


@pytest.mark.parametrize(
    "change",
    [
        {"edges": 7}, {"edges": [7]}, {"edges": [{}]}, {"tier": 7}, {"tier": "x" * 600}, {"insteadOf": [7]}, {"insteadOf": 7},
        {"edges": [json.loads(GOOD.text())["edges"][0] | {"time": "soon"}]},
        {"edges": [json.loads(GOOD.text())["edges"][0] | {"nodes": ["a"]}]},
        {"edges": [json.loads(GOOD.text())["edges"][0] | {"edge": None}]},
        {"edges": json.loads(GOOD.text())["edges"] * (MAX_EDGES + 1)},
        {"tier": "\ud800"}, {"insteadOf": ["\x1b[2J"]},
        {"edges": [json.loads(GOOD.text())["edges"][0] | {"nodes": ["edge-1", "edge\n2"]}]},
    ],
)  # fmt: skip
def test_what_is_of_another_form_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=FORM):
        parse_given_up(json.dumps(json.loads(GOOD.text()) | change))


@given(st.one_of(st.text(), st.sampled_from(["[" * 1000, "null", "1", "[]", '"x"'])))
def test_no_text_is_a_crash(text: str) -> None:
    with pytest.raises(ValueError, match=FORM):
        parse_given_up(text)
