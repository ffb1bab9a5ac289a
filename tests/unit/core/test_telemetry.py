import msgspec
import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_node, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.changes import Change
from robotapp_scheduler.core.cluster import Cluster
from robotapp_scheduler.core.robotics import NodeTelemetry


def zoned(clock: Clock | None = None, **zones: str) -> Cluster:
    return make_cluster(*(make_node(n, labels={str(Label.ZONE): z}) for n, z in zones.items()), clock=clock)


def test_a_measured_pair_is_known_from_both_ends_in_both_percentiles() -> None:
    cluster = zoned(a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}, p95_ms={"b": 22}))
    for left, right in (("a", "b"), ("b", "a")):
        assert cluster.rtt.between(left, right, 50) == (15_000.0, "measured")
        assert cluster.rtt.between(left, right, 95) == (22_000.0, "measured")
    assert cluster.rtt.between("a", "a", 95) == (0.0, "measured")


def test_of_two_readings_of_a_pair_the_younger_counts() -> None:
    clock = Clock()
    cluster = zoned(clock, a="z1", b="z2")
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    clock.forward(5)
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 40}))
    assert cluster.rtt.between("a", "b", 50)[0] == 40_000.0
    clock.forward(5)
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 12}))
    assert cluster.rtt.between("b", "a", 50)[0] == 12_000.0


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


def test_a_peer_that_answered_no_probe_is_unknown_and_not_near() -> None:
    cluster = zoned(a="z1", b="z2")
    raw = {"metadata": {"name": "a"}, "status": {"rtt": [{"peer": "b", "lossPPM": 1_000_000}]}}
    cluster.apply_telemetry(msgspec.convert(raw, NodeTelemetry))
    assert cluster.rtt.between("a", "b", 95) == (None, "unknown")


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
    reading = telemetry("a", rtt_ms={"b": 15})
    assert cluster.apply_telemetry(reading) & Change.RTT
    clock.forward(20)
    assert not cluster.apply_telemetry(reading) & Change.RTT
    clock.forward(20)
    assert cluster.tick() == Change.NONE
    assert cluster.rtt.between("a", "b", 50)[1] == "measured"


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
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    clock.forward(7)
    cluster.apply_telemetry(telemetry("b", rtt_ms={"a": 15}))
    assert cluster.rtt.oldest_age_s() == 7
    cluster.apply_telemetry(telemetry("a", rtt_ms={"b": 15}))
    assert cluster.rtt.oldest_age_s() == 0
