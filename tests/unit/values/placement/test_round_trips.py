"""Round-trip times of pairs of nodes: which of two directions counts, what loss means, and how old is too old."""

import math
from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from robotapp_api.values.placement.round_trips import Figures, RoundTrips, Rtt, figures_of

FAR = Figures(40_000.0, 60_000.0)


def entry(peer: str, ms: float | None = 10, **fields: Any) -> Rtt:
    if ms is None:
        return Rtt(peer=peer, loss_ppm=1_000_000, **fields)
    return Rtt(peer=peer, p50_us=int(ms * 1000), p95_us=int(ms * 1500), loss_ppm=0, **fields)


def received(trips: RoundTrips, node: str, *rtt: Rtt, seq: int | None = None, now_s: float = 0.0) -> frozenset[str]:
    return trips.receive(node, rtt, seq=seq, interval_s=10, now_s=now_s)


def test_the_worse_direction_counts_in_each_figure() -> None:
    trips = RoundTrips()
    received(trips, "a", Rtt(peer="b", p50_us=1, p95_us=9))
    received(trips, "b", Rtt(peer="a", p50_us=3, p95_us=5))
    assert trips.between("a", "b") == trips.between("b", "a") == Figures(3.0, 9.0)
    assert trips.around("a") == {"b": Figures(3.0, 9.0)}


def test_an_entry_without_times_is_out_of_reach_and_a_missing_entry_is_unknown() -> None:
    trips = RoundTrips()
    received(trips, "a", Rtt(peer="b"))
    assert trips.between("b", "a") == Figures(math.inf, math.inf)
    assert trips.between("a", "c") is None


def test_times_beside_a_total_loss_are_not_believed() -> None:
    assert figures_of(Rtt(peer="b", p50_us=5, p95_us=6, loss_ppm=1_000_000)) == Figures(math.inf, math.inf)


def test_half_an_entry_is_read_on_the_safe_side() -> None:
    assert figures_of(Rtt(peer="b", p50_us=5)) == Figures(5.0, math.inf)
    assert figures_of(Rtt(peer="b", p95_us=6)) == Figures(6.0, 6.0)


def test_names_of_peers_are_kept_once_however_many_nodes_report_them() -> None:
    trips = RoundTrips()
    for node, name in (("a", b'"edge-1"'), ("b", b'"edge-1"')):
        received(trips, node, entry(msgspec.json.decode(name)))  # two objects
    one, other = (next(iter(trips.reported(node))) for node in ("a", "b"))
    assert one is other


def test_a_report_names_the_peers_whose_times_are_others() -> None:
    trips = RoundTrips()
    assert received(trips, "a", entry("b"), entry("c")) == {"b", "c"}
    assert received(trips, "a", entry("b"), entry("c", 11)) == {"c"}
    assert received(trips, "a", entry("b")) == {"c"}
    assert trips.drop("a") == {"b"}
    assert trips.around("b") == {}


def test_peers_that_are_measured_no_more_are_forgotten() -> None:
    trips = RoundTrips()
    for number in range(3):
        received(trips, "a", entry(f"gone-{number}"), seq=number)
    received(trips, "a", seq=4)
    assert not trips._seen_by, "an agent that names other nodes in each report fills nobody's memory"


def test_rotation_of_peers_does_not_age_those_whose_turn_it_is_not() -> None:
    """One of four peers per round: each stays known through the rounds that measure the others."""
    trips = RoundTrips()
    last: dict[str, int] = {}
    for seq in range(1, 25):
        last["bcde"[seq % 4]] = seq
        rtt = [entry(peer, seq=measured, every_rounds=4) for peer, measured in last.items()]
        received(trips, "a", *rtt, seq=seq, now_s=10.0 * seq)
        trips.expire(10.0 * seq)
        assert trips.around("a").keys() == last.keys()


def test_a_peer_that_is_measured_no_more_ages_though_its_agent_goes_on() -> None:
    trips = RoundTrips()
    for seq in range(1, 8):
        now_s = 10.0 * seq
        received(trips, "a", entry("b", seq=1), entry("c", seq=seq), seq=seq, now_s=now_s)
        trips.expire(now_s)
        assert (trips.between("a", "b") is None) == (now_s - 10 >= 30)
        assert trips.between("a", "c") is not None


def test_no_reading_counts_for_more_than_a_day_whatever_its_agent_claims() -> None:
    trips = RoundTrips()
    trips.receive("a", [entry("b", every_rounds=100_000)], seq=1, interval_s=3600, now_s=0)
    trips.expire(86_399)
    assert trips.between("a", "b")
    trips.expire(86_400)
    assert trips.between("a", "b") is None


def test_other_figures_in_a_round_that_was_seen_do_not_make_it_younger() -> None:
    trips = RoundTrips()
    received(trips, "a", entry("b"), seq=1)
    received(trips, "a", entry("b", 20), seq=1, now_s=29)
    assert trips.between("a", "b") == Figures(20_000.0, 30_000.0)
    assert trips.expire(30) == {"a": {"b"}}
    assert received(trips, "a", entry("b", 30), seq=1, now_s=31) == frozenset()
    assert trips.between("a", "b") is None


def test_two_writers_of_one_status_that_have_stopped_measuring_do_not_keep_each_other_young() -> None:
    trips = RoundTrips()
    for step in range(5):
        for seq in (3, 3, 9) if step % 2 else (3, 9, 9):
            received(trips, "a", entry("b", float(seq)), seq=seq, now_s=10.0 * step)
    assert trips.reported("a") == {}
    assert trips.silent_from_s("a") == 30
    received(trips, "a", entry("b"), seq=10, now_s=50)
    assert trips.reported("a").keys() == {"b"}, "the first new round counts again"


def test_figures_without_a_number_that_come_back_were_measured_again() -> None:
    trips = RoundTrips()
    for step in range(8):
        received(trips, "a", entry("b", 5.0 + step % 2), now_s=10.0 * step)
    assert trips.reported("a").keys() == {"b"}


def test_an_agent_that_starts_again_is_believed_at_once() -> None:
    trips = RoundTrips()
    received(trips, "a", entry("b"), seq=900)
    trips.expire(100)
    assert received(trips, "a", entry("b"), seq=1, now_s=100) == {"b"}


def test_an_agent_that_counts_no_rounds_ages_while_its_report_stays_the_same() -> None:
    trips = RoundTrips()
    received(trips, "a", entry("b"))
    received(trips, "a", entry("b"), now_s=20)
    assert trips.expire(30) == {"a": {"b"}}
    assert received(trips, "a", entry("b"), now_s=31) == frozenset()
    assert received(trips, "a", entry("b", 11), now_s=32) == {"b"}


def test_time_runs_from_the_first_receipt_by_the_clock_of_the_reader() -> None:
    """Nothing an agent writes can make a reading last longer than three of the periods it names."""
    trips = RoundTrips()
    received(trips, "a", entry("b", every_rounds=2), seq=1, now_s=1000)
    assert trips.expire(1059.9) == {}
    assert trips.expire(1060) == {"a": {"b"}}
    assert trips.expire(1061) == {}


@given(
    st.lists(
        st.tuples(
            st.sampled_from("ab"), st.sampled_from("abc"), st.integers(0, 3), st.sampled_from([None, 1, 5]),
            st.integers(1, 3), st.floats(0, 20),
        ),
        max_size=30,
    )
)  # fmt: skip
def test_what_is_known_of_a_node_is_what_is_known_of_its_pairs(
    steps: list[tuple[str, str, int, Any, int, float]],
) -> None:
    trips, now_s = RoundTrips(), 0.0
    for node, peer, seq, ms, rounds, wait_s in steps:
        now_s += wait_s
        received(trips, node, entry(peer, ms, every_rounds=rounds), seq=seq, now_s=now_s)
        trips.expire(now_s)
        for one in "abc":
            found = {other: figures for other in "abc" if (figures := trips.between(one, other)) is not None}
            assert trips.around(one) == found


def test_a_supposed_time_holds_both_ways_whatever_was_measured_and_does_not_expire() -> None:
    trips = RoundTrips()
    trips.receive("a", [Rtt(peer="b", p50_us=10, p95_us=20)], seq=1, interval_s=10, now_s=0.0)
    trips.suppose("a", "b", Figures(40.0, 40.0), now_s=1.0)
    trips.suppose("a", "c", Figures(7.0, 7.0), now_s=1.0)
    assert trips.between("a", "b") == trips.between("b", "a") == Figures(40.0, 40.0)
    assert trips.around("c") == {"a": Figures(7.0, 7.0)}
    trips.expire(1e6)
    assert trips.between("b", "a") == Figures(40.0, 40.0)
