"""The frame of the attacks: what is listed, and how an outcome is judged."""

import pytest

from campaigns.hostile import hostile
from campaigns.hostile.attack import ATTACKS, Outcome, judge, read_memory_limit, register
from robotapp_scheduler.shell.planner.container_memory import DEFAULT_LIMIT


def test_every_attack_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert hostile.main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(ATTACKS) > 0
    assert any(line.startswith("flood-operator ") for line in lines)


def test_a_figure_above_its_limit_and_one_that_is_not_there_are_missed() -> None:
    assert judge({"a": 1.0, "b": 2.0}, {"a": 1.0}) == Outcome({"a": 1.0, "b": 2.0})
    assert judge({"a": 1.5}, {"a": 1.0}).missed == ("a: 1.5, at most 1 is allowed",)
    assert judge({"a": float("nan")}, {"a": 1.0}).missed != ()
    assert judge({}, {"a": 1.0}).missed == ("a is not measured",)


def test_a_name_is_given_once() -> None:
    hostile.import_attacks()
    with pytest.raises(ValueError, match="two attacks with the name flood-operator"):
        register("flood-operator", "again")(ATTACKS["flood-operator"].run)


def test_limits_of_memory_are_those_of_the_chart() -> None:
    assert read_memory_limit("operator") == 512 << 20
    assert read_memory_limit("scheduler") == DEFAULT_LIMIT
