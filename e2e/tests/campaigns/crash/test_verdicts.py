"""When the long campaigns fail: their exit code is the only thing a gate looks at."""

from tests.support.proxy import Moment

from campaigns.crash.crash import KillPoint, Outcome, exit_code
from campaigns.operating.apply import busy_in_quiet

POINTS = tuple(KillPoint("operator", index, Moment.BEFORE) for index in range(1, 11))


def life(*problems: str, missed: int = 0) -> Outcome:
    return Outcome(POINTS, POINTS[:missed], problems, ready_s=1.0, gone_s=1.0)


def test_a_crash_campaign_fails_on_any_problem() -> None:
    assert exit_code([life(), life("domain 7 is used twice")], least=1) == 1
    assert exit_code([life(), life()], least=1) == 0


def test_a_crash_campaign_whose_kills_did_not_strike_has_shown_nothing() -> None:
    assert exit_code([life(missed=10)], least=1) == 1
    assert exit_code([life(missed=1)] * 13, least=120) == 1
    assert exit_code([life(missed=1)] * 14, least=120) == 0


def test_one_write_per_object_is_still_too_much_when_an_app_has_many_objects() -> None:
    assert busy_in_quiet({"operator patch deployments a": 1, "operator patch deployments b": 1}, per_app_minute=2.0)
    assert busy_in_quiet({"operator patch robotapps/status a": 2}, per_app_minute=0.1)
    assert busy_in_quiet({"operator patch robotapps/status a": 1}, per_app_minute=0.1) == []
