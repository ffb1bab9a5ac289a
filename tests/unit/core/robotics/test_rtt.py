import math

import msgspec
import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_node, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.robotics_v1alpha1 import NodeTelemetry
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.robotics.rtt import PairView


def zoned(clock: Clock | None = None, **zones: str) -> Cache:
    return make_cluster(*(make_node(n, labels={str(Label.ZONE): z}) for n, z in zones.items()), clock=clock)


def measured_by_planner(cluster: Cache) -> dict[tuple[str, str], float]:
    """p95 in microseconds per measured pair, as the joint planner gets it."""
    measured = cluster.rtt.latencies().measured
    names = cluster.nodes.names
    rows = zip(measured.left, measured.right, measured.us[1], strict=True)
    return {(names[left], names[right]): float(us) for left, right, us in rows}


def test_a_measured_pair_is_known_from_both_ends_in_both_percentiles() -> None:
    cluster = zoned(a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, p95_ms={"b": 22}))
    for left, right in (("a", "b"), ("b", "a")):
        assert cluster.rtt.between(left, right, 50) == (15_000.0, "measured")
        assert cluster.rtt.between(left, right, 95) == (22_000.0, "measured")
    assert cluster.rtt.between("a", "a", 95) == (0.0, "measured")


def test_a_pair_counts_with_the_worse_of_its_two_directions() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    clock.forward(5)
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 40}))
    clock.forward(5)
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 12}))
    for left, right in (("a", "b"), ("b", "a")):
        assert cluster.rtt.between(left, right, 50) == (40_000.0, "measured")
    assert measured_by_planner(cluster) == {("a", "b"): 40_000.0, ("b", "a"): 40_000.0}


def test_the_estimate_of_two_zones_knows_the_worse_direction_of_each_pair() -> None:
    cluster = zoned(a1="a", a2="a", b1="b", b2="b")
    cluster.apply_telemetry(telemetry("a1", rtt_ms={"b1": 10}))
    cluster.apply_telemetry(telemetry("b1", rtt_ms={"a1": 30}))
    assert cluster.rtt.between("a2", "b2", 50) == (30_000.0, "estimated")


def test_pairs_nobody_measured_are_estimated_by_the_median_of_their_zones() -> None:
    cluster = zoned(a1="a", a2="a", a3="a", b1="b", b2="b", c1="c")
    cluster.apply_telemetry(telemetry("a1", rtt_ms={"b1": 10, "b2": 30}))
    cluster.apply_telemetry(telemetry("a2", rtt_ms={"b1": 20}))
    assert cluster.rtt.between("a3", "b2", 50) == (20_000.0, "estimated")
    assert cluster.rtt.between("b2", "a3", 50) == (20_000.0, "estimated")
    assert cluster.rtt.between("a3", "c1", 50) == (None, "unknown")


def test_nodes_without_a_zone_are_unknown_unless_measured() -> None:
    cluster = zoned(a="z", b="z")
    cluster.apply_node(make_node("bare"))
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 5}))
    assert cluster.rtt.between("bare", "a", 50) == (None, "unknown")


@pytest.mark.parametrize("entry", [{"lossPPM": 1_000_000}, {}, {"lossPPM": 1_000_000, "p50Us": 9, "p95Us": 9}], ids=str)
def test_a_link_that_loses_every_probe_is_out_of_reach_and_not_unknown(entry: dict[str, int]) -> None:
    cluster = zoned(a="z1", b="z2")
    raw = {"metadata": {"name": "a"}, "status": {"rtt": [{"peer": "b", **entry}]}}
    cluster.apply_telemetry(msgspec.convert(raw, NodeTelemetry))
    for percentile in (50, 95):
        assert cluster.rtt.between("a", "b", percentile) == (math.inf, "measured")
        assert cluster.rtt.between("b", "a", percentile) == (math.inf, "measured")


def test_one_dead_direction_is_enough_whatever_the_other_end_reports() -> None:
    cluster = zoned(a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", lost=["b"]))
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 1}))
    assert cluster.rtt.between("a", "b", 95) == (math.inf, "measured")
    assert measured_by_planner(cluster) == {("a", "b"): math.inf, ("b", "a"): math.inf}


def test_a_robot_out_of_reach_does_not_make_its_zone_so() -> None:
    cluster = zoned(a="a", b1="b", b2="b", b3="b")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b1": 10}, lost=["b2"]))
    assert cluster.rtt.between("a", "b3", 95) == (10_000.0, "estimated")
    cluster = zoned(a="a", b1="b", b2="b")
    cluster.apply_telemetry(telemetry("a", lost=["b1"]))
    assert cluster.rtt.between("a", "b2", 95) == (None, "unknown")


def test_a_reading_older_than_three_intervals_is_unknown_by_our_own_clock() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, interval_s=10))
    clock.forward(29)
    assert cluster.tick() == Change.NONE
    assert cluster.rtt.between("a", "b", 50)[1] == "measured"
    clock.forward(2)
    assert cluster.tick() == Change.RTT
    assert cluster.rtt.between("a", "b", 50) == (None, "unknown")


def test_an_unchanged_heartbeat_keeps_a_reading_alive_without_waking_anybody() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    assert cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, seq=1)) & Change.RTT
    clock.forward(20)
    assert not cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, seq=2)) & Change.RTT
    clock.forward(20)
    assert cluster.tick() == Change.NONE
    assert cluster.rtt.between("a", "b", 50)[1] == "measured"


def test_writing_the_same_round_again_does_not_make_it_younger() -> None:
    """What the operator does when it asks for other probes, and what a stuck agent may do for ever."""
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    reading = telemetry("a", rtt_ms={"b": 15}, load={"cpuPercent": 5}, seq=7)
    cluster.apply_telemetry(reading)
    for _ in range(29):
        clock.forward(1)
        cluster.apply_telemetry(reading)
    assert cluster.rtt.between("a", "b", 50)[1] == "measured"
    clock.forward(1)
    assert cluster.tick() & Change.RTT
    for _ in range(3):
        assert cluster.rtt.between("a", "b", 50) == (None, "unknown")
        assert cluster.rtt.load("a") is None
        cluster.apply_telemetry(reading)


def test_the_load_of_a_silent_agent_is_unknown() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1")
    cluster.apply_telemetry(telemetry("a", load={"cpuPercent": 90}, seq=1))
    clock.forward(31)
    assert cluster.tick() & Change.LOAD
    assert cluster.rtt.load("a") is None
    assert cluster.tick() == Change.NONE


def test_a_removed_agent_takes_its_readings_with_it() -> None:
    cluster = zoned(a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    assert cluster.remove_telemetry(telemetry("a")) & Change.RTT
    assert cluster.rtt.between("a", "b", 50) == (None, "unknown")


def test_rows_follow_nodes_that_come_go_and_change_zone() -> None:
    cluster = zoned(a="a", b="b")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    assert cluster.rtt.from_node("a", 50).rtt_us.tolist() == [0.0, 15_000.0]
    cluster.apply_node(make_node("b2", labels={str(Label.ZONE): "b"}))
    assert cluster.rtt.from_node("a", 50).rtt_us.tolist() == [0.0, 15_000.0, 15_000.0]
    cluster.apply_node(make_node("b2", labels={str(Label.ZONE): "elsewhere"}))
    assert np.isnan(cluster.rtt.from_node("a", 50).rtt_us[2])
    cluster.remove_node("b")
    assert np.isnan(cluster.rtt.from_node("a", 50).rtt_us[1])


def test_rows_cannot_be_written() -> None:
    row = zoned(a="a").rtt.from_node("a", 50)
    with pytest.raises(ValueError, match="read-only"):
        row.rtt_us[0] = 1.0


def test_an_estimate_that_is_a_second_behind_is_corrected_by_the_next_tick() -> None:
    clock = Clock()
    cluster = zoned(clock, a1="a", a2="a", b1="b")
    cluster.apply_telemetry(telemetry("a1", rtt_ms={"b1": 10}))
    assert cluster.rtt.between("a2", "b1", 50) == (10_000.0, "estimated")
    clock.forward(0.2)
    cluster.apply_telemetry(telemetry("a1", rtt_ms={"b1": 80}))
    assert cluster.rtt.between("a2", "b1", 50) == (10_000.0, "estimated")
    clock.forward(1.0)
    assert cluster.tick() == Change.RTT
    assert cluster.rtt.between("a2", "b1", 50) == (80_000.0, "estimated")
    assert cluster.tick() == Change.NONE


def test_the_oldest_reading_in_use_has_an_age_and_none_has_none() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    assert cluster.rtt.oldest_age_s() is None
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, seq=1))
    clock.forward(7)
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 15}, seq=1))
    assert cluster.rtt.oldest_age_s() == 7
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, seq=2))
    assert cluster.rtt.oldest_age_s() == 0


def test_a_measured_pair_is_as_old_as_the_direction_that_counts() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2", c="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 40}, seq=1, interval_s=60))
    clock.forward(5)
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 15}, seq=1, interval_s=60))
    clock.forward(4)
    assert cluster.rtt.known("b", "a", 95) == PairView(40.0, "measured", 9.0, ())
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 40}, seq=1, interval_s=60))
    assert cluster.rtt.known("a", "b", 95).age_s == 9.0, "the same round written again"
    cluster.apply_telemetry(telemetry("a", lost=["b"], seq=2, interval_s=60))
    assert cluster.rtt.known("a", "b", 95) == PairView(None, "measured", 0.0, ())
    clock.forward(1)
    assert cluster.rtt.known("a", "c", 95) == PairView(None, "unknown", None, ())


def test_an_estimated_pair_names_its_zones() -> None:
    cluster = zoned(a="z1", b="z2", c="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    assert cluster.rtt.known("c", "a", 95) == PairView(15.0, "estimated", None, ("z2", "z1"))
