"""Which part of a campaign is tried today."""

import pytest
from tests.support.seeds import EXAMPLES, choose_for_today, daily_seed


def test_three_days_in_a_row_have_each_of_them_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTAPP_SAMPLES", raising=False)
    monkeypatch.delenv(EXAMPLES, raising=False)
    found = []
    for day in (739_000, 739_001, 739_002):
        monkeypatch.setenv("ROBOTAPP_SEED", str(day))
        assert daily_seed() == day
        found += choose_for_today("abcdefgh")
    assert sorted(found) == list("abcdefgh")
