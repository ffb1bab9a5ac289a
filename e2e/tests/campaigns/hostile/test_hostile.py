"""The frame of the attacks: what is listed, and how an outcome is judged."""

import ipaddress
from typing import Any
from unittest.mock import Mock

import pytest

from campaigns.hostile import bystanders, hostile
from campaigns.hostile.attack import ATTACKS, Outcome, judge, read_memory_limit, register
from campaigns.hostile.attacks.large_objects import APPS
from campaigns.hostile.attacks.late_components import COMPONENTS, make_late_app
from campaigns.hostile.port_flood import list_sources
from campaigns.hostile.uploads import SOURCE
from campaigns.operating.large_apps import SHAPES
from robotapp_api.checks.size import MOST_BYTES, measure_spec
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.record import parse_record
from robotapp_operator.plan.spec.validate import problems_alone
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


def test_the_table_has_a_row_for_each_figure_and_each_missed_limit() -> None:
    result = {"figures": {"MiB": 12.5}, "missed": ["too much"], "seconds": 3.0, "load": 1.5}
    rows = hostile.make_table({"flood": result})
    assert [row.split() for row in rows[1:]] == [
        ["flood", "MiB", "12.5"],
        ["flood", "seconds", "3"],
        ["flood", "load", "1.5"],
        ["flood", "MISSED:", "too", "much"],
    ]


def test_an_app_that_is_never_ready_misses_every_limit_and_ends_no_attack(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bystanders, "start_one", Mock(side_effect=[TimeoutError, *[0.5] * 1_000]))
    monkeypatch.setattr(bystanders, "PAUSE_S", 0.001)
    with bystanders.Bystanders(Mock(), "beside") as others:
        others.wait_for_more(2)
    assert others.ready_s[1] == 0.5
    assert judge({"s": others.slowest_s}, {"s": 3.0}).missed == ("s: inf, at most 3 is allowed",)


def test_a_crowd_comes_from_addresses_of_its_own() -> None:
    sources = list_sources(60_000)
    assert len({*sources}) == 60_000
    assert all(ipaddress.ip_address(source).is_loopback for source in sources)
    assert not {"127.0.0.1", SOURCE} & {*sources}


@pytest.mark.parametrize("when", ["Never", "BudgetExceeded"])
def test_a_crowded_app_is_accepted_and_has_as_many_late_components_as_there_may_be_edges(when: str) -> None:
    app = make_late_app("late-0", when=when)
    assert problems_alone(parse_app(app)) == ()
    assert len(app["spec"]["edges"]) == COMPONENTS == len(app["spec"]["components"]) - 1


@pytest.mark.parametrize("shape", APPS)
def test_a_hoarded_app_is_accepted_and_nearly_as_large_as_it_may_be(shape: str) -> None:
    app = SHAPES[shape]("x")
    assert parse_app(app).spec.suspend
    assert 0.9 * MOST_BYTES < measure_spec(app["spec"]).total_bytes <= MOST_BYTES


def parse_app(app: dict[str, Any]) -> App:
    record = parse_record(app)
    assert record.app is not None, record.problems
    return record.app
