"""The campaign of the recorder counts what a kill has lost and what is missing between."""

from campaigns.recordings.recordings import judge_life


def test_what_was_sent_after_the_last_recorded_message_is_lost() -> None:
    life = judge_life([1, 2, 3, 10, 11, 12], first=10, sent=20, seconds=1.0)
    assert (life.kept, life.lost, life.gaps) == (3, 8, 0)


def test_numbers_that_are_missing_before_the_last_one_are_a_gap() -> None:
    assert judge_life([10, 11, 14], first=10, sent=14, seconds=1.0).gaps == 2


def test_a_life_that_kept_nothing_has_lost_all() -> None:
    life = judge_life([1, 2], first=10, sent=15, seconds=1.0)
    assert (life.kept, life.lost) == (0, 5)
