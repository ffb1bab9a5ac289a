"""`scripts/bench joint`: certificates of small problems against exhaustive search."""

from tests.support.seeds import daily_seed

from campaigns.scheduler.joint import wrong_certificates

SAMPLE = 40
"""Each is solved with ample time, and twice with little."""


def test_no_certificate_of_todays_small_problems_is_wrong() -> None:
    """`scripts/bench joint --certificates N` has more; ROBOTAPP_SEED repeats a day."""
    assert wrong_certificates(daily_seed(), SAMPLE) == []
