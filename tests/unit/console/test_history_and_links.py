"""Sparklines of half an hour, and round trips between zones."""

from math import inf

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.unit.console.objects import NOW_S, node, snapshot, telemetry

from robotapp_client import Change, Endpoint
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.views.history import SLOT_S, SLOTS, LinkHistory, draw_sparkline
from robotapp_console.views.links import MOST_ZONES, ZoneEstimates, build_zone_matrix, find_link, rate_heat, read_zones
from robotapp_console.views.objects import Telemetry

NODES = ("a", "b", "c", "d")
REPORTS = st.tuples(
    st.sampled_from(NODES),
    st.one_of(st.none(), st.dictionaries(st.sampled_from(NODES), st.sampled_from((1.0, 2.0, 30.0)))),
    st.dictionaries(st.sampled_from(NODES), st.sampled_from(("hall-1", "hall-2")), min_size=2),
)


@given(st.lists(REPORTS, max_size=12))
def test_links_that_are_kept_are_those_that_would_be_computed_anew(
    steps: list[tuple[str, dict[str, float] | None, dict[str, str]]],
) -> None:
    informers = InformerSet(Endpoint("https://127.0.0.1:1"))
    for number, (name, rtt, zones) in enumerate(steps):
        report = None if rtt is None else telemetry(name, rtt=rtt, written_s=NOW_S + number)
        new = None if report is None else msgspec.convert(report, Telemetry)
        informers._take_telemetry(Change("DELETED" if new is None else "MODIFIED", name, None, new))
        informers._links.use_zones(zones)
        for node_name in NODES:
            assert informers._links.find(node_name) == find_link(node_name, zones, informers._round_trips)
        assert informers._links.find_matrix() == build_zone_matrix(zones, informers._round_trips)


def test_the_newest_value_is_last_and_gaps_are_none() -> None:
    history = LinkHistory()
    history.record({"a": 1000.0}, 0.0)
    history.record({"a": 3000.0}, 2 * SLOT_S)
    values = history.list_values("a")
    assert len(values) == SLOTS
    assert values[-3:] == (1000.0, None, 3000.0)


def test_the_worst_value_of_a_slot_is_kept() -> None:
    history = LinkHistory()
    for value in (1000.0, inf, 2000.0):
        history.record({"a": value}, 5.0)
    assert history.list_values("a")[-1] == inf


def test_after_half_an_hour_without_a_value_a_row_is_gone() -> None:
    history = LinkHistory()
    history.record({"a": 1000.0}, 0.0)
    history.record({"b": 1000.0}, SLOTS * SLOT_S)
    assert history.list_values("a") == ()
    assert len(history.list_values("b")) == SLOTS


@given(st.lists(st.tuples(st.floats(0, 1e7), st.floats(0, 1e5)), max_size=40))
def test_a_row_never_holds_more_than_half_an_hour_whatever_the_clock_does(steps: list[tuple[float, float]]) -> None:
    history = LinkHistory()
    for now_s, value in steps:
        history.record({"a": value}, now_s)
        assert len(history.list_values("a")) == SLOTS


@given(st.lists(st.one_of(st.none(), st.just(inf), st.floats(0, 1e9)), max_size=SLOTS))
def test_every_history_has_a_picture_inside_its_box(values: list[float | None]) -> None:
    line = draw_sparkline(tuple(values))
    assert len(line.lost) == values.count(inf)
    for path in line.paths:
        for point in path.removeprefix("M").removesuffix("h1.5").split("L"):
            x, y = map(float, point.split(","))
            assert 0 <= x <= 120.1
            assert 0 <= y <= 24


def test_an_unknown_history_says_so() -> None:
    assert draw_sparkline(()).label == "no measurement in the last 30 minutes"
    assert draw_sparkline((1000.0, inf)).label == "last 30 minutes: 1 to 1 ms, unreachable 1 times"


NETWORK = snapshot(
    nodes=[node("r1", zone="hall"), node("e1", zone="hall"), node("c1", zone="cloud"), node("c2", zone="cloud")],
    reports=[
        telemetry("r1", rtt={"e1": 2.0, "c1": 60.0}, written_s=NOW_S),
        telemetry("c1", rtt={"r1": 70.0}, written_s=NOW_S),
    ],
)


def test_the_matrix_holds_the_median_of_measured_pairs_by_the_worse_direction() -> None:
    matrix = build_zone_matrix(read_zones(NETWORK.nodes), NETWORK.round_trips)
    assert matrix.zones == ("cloud", "hall")
    assert [[cell.text for cell in row] for row in matrix.rows] == [["", "70 ms"], ["70 ms", "2 ms"]]
    assert matrix.rows[0][1].pairs == 1
    assert matrix.rows[0][0].heat == 0


def test_more_zones_than_can_be_read_are_counted() -> None:
    zones = {f"n{i}": f"z{i:02}" for i in range(MOST_ZONES + 3)}
    matrix = build_zone_matrix(zones, NETWORK.round_trips)
    assert (len(matrix.zones), matrix.omitted) == (MOST_ZONES, 3)


def test_a_pair_that_was_not_measured_is_estimated_by_its_zones() -> None:
    estimates = ZoneEstimates(read_zones(NETWORK.nodes), NETWORK.round_trips)
    assert estimates.estimate("e1", "c2") == (70_000.0, ("hall", "cloud"))
    assert estimates.estimate("c1", "c2") is None
    assert estimates.estimate("e1", "unknown") is None


def test_heat_grows_with_the_time() -> None:
    heats = [rate_heat(time) for time in (500, 2_000, 5_000, 15_000, 60_000, 500_000, inf)]
    assert heats == [1, 2, 3, 4, 5, 6, 6]
