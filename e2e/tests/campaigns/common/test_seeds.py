"""Which part of a campaign is tried today."""

import datetime as dt

import pytest
from tests.support.seeds import TODAY, daily_seed, third_of_today


def test_three_days_in_a_row_have_each_of_them_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTAPP_SAMPLES", raising=False)
    found = []
    for day in (739_000, 739_001, 739_002):
        monkeypatch.setenv("ROBOTAPP_SEED", str(day))
        assert daily_seed() == day
        found += third_of_today("abcdefgh")
    assert sorted(found) == list("abcdefgh")


def test_who_wants_all_has_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTAPP_SAMPLES", "all")
    assert third_of_today(range(5)) == [0, 1, 2, 3, 4]


def test_a_run_that_goes_on_after_midnight_keeps_its_day(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTAPP_SEED", raising=False)
    monkeypatch.setenv(TODAY, "739000")
    assert daily_seed() == 739_000
    monkeypatch.delenv(TODAY)
    today = {dt.datetime.now(tz=dt.UTC).toordinal()}
    found = daily_seed()
    assert found in today | {dt.datetime.now(tz=dt.UTC).toordinal()}
