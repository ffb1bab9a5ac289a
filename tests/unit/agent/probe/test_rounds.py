import random

import pytest

from robotapp_agent.probe.rounds import (
    LOSS_ROUNDS,
    MOST_WINDOWS,
    PROBES,
    Round,
    RoundResult,
    RoundSummary,
    Trips,
    jitter_us,
    quantile,
    schedule,
    timeout_s,
)

SILENCE: Trips = [None] * PROBES


def one(summary: RoundSummary, trips: Trips, peer: str = "b") -> RoundResult:
    (result,) = summary.round({peer: trips}).results
    return result


def silence(summary: RoundSummary, *, rounds: int, peer: str = "b") -> Round:
    for _ in range(rounds):
        last = summary.round({peer: SILENCE})
    return last


def with_losses(lost: int) -> Trips:
    return [None] * lost + [1000] * (PROBES - lost)


def test_figures_of_a_round() -> None:
    trips = [400, 100, 200, None, 300, 500, 600, 700, 800, 900]
    assert one(RoundSummary(), trips) == RoundResult("b", 500, 900, 138, 100_000, 10, 9)


def test_a_peer_that_answers_nothing_in_one_round_is_named_and_in_two_rounds_it_is_unreachable_and_has_no_times() -> (
    None
):
    summary = RoundSummary()
    one(summary, with_losses(0))
    assert silence(summary, rounds=1) == Round(silent=("b",))
    for _ in range(3):
        assert silence(summary, rounds=1) == Round((RoundResult("b", None, None, None, 1_000_000, 10, 0),))


def test_a_peer_that_never_answered_is_unreachable_in_its_second_round() -> None:
    summary = RoundSummary()
    assert silence(summary, rounds=1) == Round(silent=("b",))
    assert silence(summary, rounds=1).results


@pytest.mark.parametrize("rounds", [1, 3])
def test_a_link_that_returns_is_measured_in_its_first_round_and_the_silence_is_no_loss(rounds: int) -> None:
    summary = RoundSummary()
    one(summary, with_losses(1))
    silence(summary, rounds=rounds)
    back = one(summary, with_losses(0))
    assert (back.p50_us, back.loss_ppm) == (1000, 0)
    assert silence(summary, rounds=1).silent


def test_in_the_round_in_which_a_link_returns_only_what_came_after_the_first_answer_counts_as_loss() -> None:
    summary = RoundSummary()
    silence(summary, rounds=2)
    assert one(summary, [None] * 6 + [1000, None, 1000, 1000]).loss_ppm == 250_000
    assert one(summary, with_losses(0)).loss_ppm == round(1e6 / 14)


def test_loss_is_over_the_last_rounds() -> None:
    summary = RoundSummary()
    seen = [one(summary, with_losses(lost)).loss_ppm for lost in [1] + [0] * LOSS_ROUNDS]
    assert seen[0] == 100_000
    assert seen[LOSS_ROUNDS - 1] == round(1e6 / (PROBES * LOSS_ROUNDS))
    assert seen[LOSS_ROUNDS] == 0


def test_one_answer_has_times_but_no_jitter() -> None:
    assert one(RoundSummary(), [None] * 9 + [70]) == RoundResult("b", 70, 70, None, 900_000, 10, 1)


def test_peers_are_apart_and_of_many_the_latest_are_kept() -> None:
    summary = RoundSummary()
    one(summary, with_losses(5))
    assert one(summary, with_losses(0), "c").loss_ppm == 0
    assert one(summary, with_losses(0)).loss_ppm == 250_000
    for index in range(MOST_WINDOWS):
        one(summary, with_losses(0), f"node-{index}")
    assert repr(summary) == f"<RoundSummary of {MOST_WINDOWS} peers>"
    assert one(summary, with_losses(0)).loss_ppm == 0


def test_a_peer_to_which_nothing_was_sent_has_no_result() -> None:
    assert RoundSummary().round({"b": []}) == Round()


@pytest.mark.parametrize(
    ("percent", "values", "found"),
    [(50, [7], 7), (95, [7], 7), (50, [1, 2], 1), (50, [1, 2, 3], 2), (95, list(range(1, 101)), 95), (95, [1, 2], 2)],
)
def test_a_quantile_is_a_value_that_was_measured(percent: int, values: list[int], found: int) -> None:
    assert quantile(values, percent) == found


def test_jitter_is_the_mean_step() -> None:
    assert jitter_us([100, 110, 90]) == 15
    assert jitter_us([100]) is None


@pytest.mark.parametrize("seconds", [0.5, 10, 100])
def test_ten_probes_per_peer_are_spread_over_the_round_and_the_last_one_can_still_be_answered(seconds: float) -> None:
    shots = schedule(16, seconds=seconds, uniform=random.Random(1).random)
    step_s = (seconds - timeout_s(seconds)) / PROBES
    assert [shot.offset_s for shot in shots] == sorted(shot.offset_s for shot in shots)
    for peer in range(16):
        offsets_s = [shot.offset_s for shot in shots if peer in shot.peers]
        assert [int(offset_s / step_s) for offset_s in offsets_s] == list(range(PROBES))
        assert offsets_s[-1] <= seconds - timeout_s(seconds)


def test_few_peers_are_probed_apart_and_many_in_four_groups() -> None:
    assert {len(shot.peers) for shot in schedule(4, seconds=10, uniform=random.random)} == {1}
    assert len(schedule(16, seconds=10, uniform=random.random)) == 4 * PROBES


def test_no_peers_no_probes() -> None:
    assert schedule(0, seconds=10, uniform=random.random) == ()
