"""Links and their changes as data."""

import dataclasses

import pytest

from robotapp_testbed.switch.links import FIELDS, LIMITS, Link, LinkChange, from_state, problem_of


def test_every_field_of_a_link_can_be_changed_and_no_other() -> None:
    assert set(FIELDS) == {field.name for field in dataclasses.fields(Link)}
    assert "known are delay_ms" in problem_of("delay", 3)


@pytest.mark.parametrize("name", LIMITS)
def test_numbers_are_bounded(name: str) -> None:
    assert not problem_of(name, 0)
    assert not problem_of(name, LIMITS[name])
    for wrong in (-0.001, LIMITS[name] * 1.01, float("nan"), float("inf"), True, "1", None):
        assert problem_of(name, wrong)


def test_a_wrong_value_is_refused_where_it_is_written() -> None:
    with pytest.raises(ValueError, match=r"loss: 2 is not between 0 and 1"):
        LinkChange({"loss": 2}, node="a")


def test_a_change_is_for_a_pair_or_for_a_node() -> None:
    pair = LinkChange({"delay_ms": 3}, origin="a", target="b", one_way=True)
    assert pair.as_json() == {"from": "a", "to": "b", "one_way": True, "delay_ms": 3}
    assert pair.nodes() == ("a", "b")
    node = LinkChange({"down": True}, node="a")
    assert node.as_json() == {"node": "a", "down": True}
    assert node.nodes() == ("a",)


def test_the_switchs_answer_becomes_a_link() -> None:
    state = {"from": "a", "to": "b", **dataclasses.asdict(Link(delay_ms=3, down=True))}
    assert from_state(state) == (("a", "b"), Link(delay_ms=3, down=True))
