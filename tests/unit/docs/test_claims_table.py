"""The table of weaker rules in docs/claims.md names what catches each, and `scripts/bench claims` goes through it."""

import re

import pytest

from campaigns.claims import claims
from campaigns.claims.claims_weakened import ALL, FOUND_BY_MODELS
from campaigns.claims.model.explore import Result
from campaigns.claims.model.scenarios import ALL as SCENARIOS
from robotapp_testbed.binaries.pins import REPOSITORY

ROW = re.compile(r"^\| [^|]+ \| `(\w+)` \| ((?:`\w+`(?:, )?)+) \|", re.MULTILINE)


def test_the_table_names_the_scenarios_of_all_weaker_rules() -> None:
    text = (REPOSITORY / "docs" / "claims.md").read_text()
    rows = {name: tuple(re.findall(r"`(\w+)`", models)) for name, models in ROW.findall(text)}
    assert rows == FOUND_BY_MODELS
    assert rows.keys() == ALL.keys()


def test_each_of_them_is_a_scenario_that_must_end_with_harm() -> None:
    for names in FOUND_BY_MODELS.values():
        for name in names:
            assert "OK" not in SCENARIOS[name].expect


def test_a_weaker_rule_that_a_scenario_lets_pass_fails_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    passes = Result("OK", "", states=10, seconds=0.1)
    caught = Result("LOST", "", states=10, seconds=0.1)
    assert claims._table({"M7": caught, "DM2": passes, "M10": caught}) == ["uid_only"]
    text = capsys.readouterr().out
    assert "?? uid_only               M7 LOST, DM2 OK" in text
    assert "weaker rules caught by the models: 1 of 2 that were tried, of 12" in text


def test_one_scenario_can_be_run_and_its_row_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert claims.main(["DM5"]) == 0
    text = capsys.readouterr().out
    assert "all 1 as expected" in text
    assert "terminating_is_gone" in text


def test_the_table_alone_chooses_every_scenario_it_names_and_no_other() -> None:
    named = {name for names in FOUND_BY_MODELS.values() for name in names}
    assert set(claims._chosen(everything=False, table=True)) == named
