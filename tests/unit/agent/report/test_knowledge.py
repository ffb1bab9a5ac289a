"""What the agent knows from round to round."""

from robotapp_agent.probe.rounds import RoundResult
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.report.load import CpuTimes, Sample


def knowledge(*, seq: int = 100, fixed_interval_s: int = 0) -> Knowledge:
    return Knowledge(arch="arm64", realtime=False, seq=seq, fixed_interval_s=fixed_interval_s)


def result(peer: str, p50_us: int | None = 1000) -> RoundResult:
    return RoundResult(peer, p50_us, p50_us, None, 0 if p50_us else 1_000_000, 10, 10 if p50_us else 0)


def peers(known: Knowledge) -> dict[str, int]:
    return {trip.peer: trip.seq for trip in known.readings().round_trips or ()}


def test_rounds_go_on_from_the_number_of_the_earlier_run() -> None:
    known = knowledge(seq=100)
    known.round_ended([result("a")], every_rounds={})
    known.idle_round()
    assert known.readings().seq == 102
    assert peers(known) == {"a": 101}


def test_round_trips_are_unknown_until_the_first_round_has_ended() -> None:
    known = knowledge()
    assert known.readings().round_trips is None
    known.round_ended([], every_rounds={})
    assert known.readings().round_trips == ()


def test_a_peer_that_is_measured_in_turn_keeps_its_result_for_three_of_its_turns() -> None:
    known = knowledge(seq=0)
    known.round_ended([result("each"), result("rare")], every_rounds={"rare": 4})
    for _ in range(2):
        known.round_ended([], every_rounds={})
    assert peers(known) == {"each": 1, "rare": 1}
    known.round_ended([], every_rounds={})
    assert peers(known) == {"rare": 1}
    for _ in range(9):
        known.round_ended([], every_rounds={})
    assert peers(known) == {}


def test_the_latest_64_round_trips_are_kept() -> None:
    known = knowledge(seq=0)
    for number in range(10):
        names = [f"node-{number}-{each}" for each in range(16)]
        known.round_ended([result(name) for name in names], every_rounds=dict.fromkeys(names, 1000))
    assert len(peers(known)) == 64
    assert set(peers(known).values()) == {7, 8, 9, 10}


def test_the_interval_follows_the_number_of_nodes_unless_it_is_fixed() -> None:
    known, fixed = knowledge(), knowledge(fixed_interval_s=2)
    known.nodes = fixed.nodes = 5000
    assert (known.interval_s, fixed.interval_s) == (100, 2)


def busy(at_s: float, busy_ticks: int) -> Sample:
    return Sample(at_s, cpu=CpuTimes(busy_ticks, int(100 * at_s)))


def test_the_load_is_an_average_over_half_an_interval() -> None:
    known = knowledge(fixed_interval_s=100)
    for at_s in range(100, 200, 10):
        known.sampled(busy(at_s, 0))
    known.sampled(busy(200, 1000))
    assert known.readings().load.cpu_percent == 20
    for at_s in range(210, 260, 10):
        known.sampled(busy(at_s, 1000))
    assert known.readings().load.cpu_percent == 0


def test_in_a_small_cluster_the_load_is_that_of_ten_seconds() -> None:
    known = knowledge(fixed_interval_s=10)
    known.sampled(busy(100, 0))
    known.sampled(busy(110, 0))
    known.sampled(busy(120, 1000))
    assert known.readings().load.cpu_percent == 100
