"""Verdicts of `scripts/bench probes` from figures made by hand, and the two rules they follow."""

import pytest

from campaigns.network import probes
from campaigns.network.probes import Accuracy, Cost, Loss, Notice, is_as_ping, is_likely

BAD = (
    [Accuracy(0, 120, [430, None])],
    [Loss(0.05, 60, 600)],
    Notice([4], [1]),
    [Cost(3, 0.006)],
    60.0,
)


def test_what_falls_short_is_said_in_a_sentence() -> None:
    assert probes.verdict(*BAD) == [
        "0 ms: [430, None] us are not all near ping's 120",
        "5% loss: 60 of 600 is unlikely",
        "noticed too late: Notice(down=[4], up=[1])",
        "3 peers cost 0.60% of a core, more than 0.5%",
        "a forged datagram costs 60 us",
    ]


@pytest.mark.parametrize(
    ("p50_us", "near"), [(430, False), (411, True), (None, False), (1_000_000 // 9, False), (100, True)]
)
def test_near_ping_is_a_tenth_and_three_tenths_of_a_millisecond(p50_us: int | None, near: bool) -> None:
    assert is_as_ping(p50_us, 101) == near


@pytest.mark.parametrize(
    ("lost", "sent", "share", "likely"),
    [(0, 120, 0.01, True), (6, 120, 0.01, False), (5, 100, 0.05, True), (0, 200, 0.05, False), (12, 100, 0.05, False)],
)
def test_a_loss_is_likely_within_the_99_percent_interval(lost: int, sent: int, share: float, likely: bool) -> None:
    assert is_likely(lost, sent, share) == likely
