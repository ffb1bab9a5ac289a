"""Estimates of pairs that nobody measured: whose last hop counts, who counts as typical, and when terms are fitted anew."""

import time

import numpy as np
import pytest
from tests.support.scheduling import Clock, make_cluster, make_node, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change

RACK = [f"rack-{i}" for i in range(6)]
FLOOR = [f"floor-{i}" for i in range(6)]
WIFI_MS = dict(zip(FLOOR, (0, 0, 0, 0, 30, 70), strict=True))
"""What the last hop of a node on the floor adds: four wired machines and two robots."""


def zoned(names: list[str], clock: Clock | None = None) -> Cache:
    nodes = (make_node(name, labels={str(Label.ZONE): name.split("-")[0]}) for name in names)
    return make_cluster(*nodes, clock=clock)


def plant(clock: Clock | None = None) -> Cache:
    """Racks 10 ms from the floor. Each machine on the floor measured three racks and one neighbour."""
    cluster = zoned(RACK + FLOOR, clock)
    for at, name in enumerate(FLOOR):
        far = {RACK[(at + k) % 6]: 10 + WIFI_MS[name] for k in range(3)}
        near = FLOOR[(at + 1) % 6]
        cluster.apply_telemetry(telemetry(name, rtt_ms={**far, near: 1 + WIFI_MS[name] + WIFI_MS[near]}))
    return cluster


def ms(cluster: Cache, one: str, other: str) -> float | None:
    time_us, source = cluster.rtt.between(one, other, 95)
    assert source == ("unknown" if time_us is None else "estimated")
    return None if time_us is None else time_us / 1000


def test_the_last_hop_of_a_robot_counts_on_all_its_paths() -> None:
    cluster = plant()
    assert ms(cluster, "floor-0", "rack-4") == pytest.approx(10, abs=0.5)
    assert ms(cluster, "floor-4", "rack-3") == pytest.approx(40, abs=0.5)
    assert ms(cluster, "floor-5", "rack-4") == pytest.approx(80, abs=0.5)
    assert ms(cluster, "floor-2", "floor-5") == pytest.approx(71, abs=1.5)


def test_a_node_of_which_fewer_than_three_pairs_are_measured_counts_as_typical_of_its_zone() -> None:
    cluster = plant()
    cluster.apply_node(make_node("floor-new", labels={str(Label.ZONE): "floor"}))
    assert ms(cluster, "floor-new", "rack-0") == pytest.approx(10, abs=0.5)
    cluster.apply_telemetry(telemetry("floor-new", rtt_ms={"rack-1": 500, "rack-2": 500}))
    assert ms(cluster, "floor-new", "rack-0") == pytest.approx(10, abs=0.5)


def test_of_a_node_that_nobody_reaches_nothing_is_estimated() -> None:
    cluster = plant()
    cluster.apply_telemetry(telemetry("floor-1", lost=["rack-1", "rack-2", "floor-2"]))
    cluster.apply_telemetry(telemetry("floor-0", rtt_ms={"rack-0": 10}))
    assert ms(cluster, "floor-1", "rack-5") is None
    assert ms(cluster, "rack-5", "floor-1") is None
    assert ms(cluster, "floor-2", "rack-5") == pytest.approx(10, abs=0.5)


def test_no_estimate_is_below_the_shortest_round_trip_that_was_measured() -> None:
    """Both are near all others in a zone of slow links: the sum of the terms is less than nothing."""
    names = [f"a-{i}" for i in range(8)]
    cluster = zoned(names)
    for name in names[:6]:
        cluster.apply_telemetry(telemetry(name, rtt_ms={peer: 60 for peer in names[:6] if peer != name}))
    for name in names[6:]:
        cluster.apply_telemetry(telemetry(name, rtt_ms=dict.fromkeys(names[:5], 2)))
    assert ms(cluster, "a-6", "a-7") == 2


def test_a_pair_of_zones_that_nobody_measured_is_unknown() -> None:
    cluster = plant()
    cluster.apply_node(make_node("cloud-0", labels={str(Label.ZONE): "cloud"}))
    assert ms(cluster, "cloud-0", "rack-0") is None
    assert ms(cluster, "rack-0", "rack-1") is None


def test_a_thousand_robots_of_one_reading_each_are_fitted_without_warnings() -> None:
    names = [f"z-{i}" for i in range(1000)]
    cluster = zoned(names)
    for at, name in enumerate(names):
        cluster.apply_telemetry(telemetry(name, rtt_ms={names[at - 1]: 5}))
    assert ms(cluster, "z-0", "z-500") == pytest.approx(5)


def large(clock: Clock) -> tuple[Cache, list[str]]:
    """More readings than are fitted at once."""
    names = [f"{'ab'[i % 2]}-{i}" for i in range(600)]
    cluster = zoned(names, clock)
    for at, name in enumerate(names):
        peers = {names[(at + 1 + 37 * k) % 600] for k in range(16)}
        cluster.apply_telemetry(telemetry(name, rtt_ms=dict.fromkeys(peers, 20), interval_s=600))
    return cluster, names


def test_in_a_large_cluster_a_fit_goes_forward_by_ticks_and_the_old_terms_are_used_meanwhile() -> None:
    clock = Clock()
    cluster, names = large(clock)
    before = cluster.rtt.between(names[0], names[2], 95)
    for name in names[:40]:
        cluster.apply_telemetry(telemetry(name, rtt_ms=dict.fromkeys(names[100:116], 90), interval_s=600))
    clock.forward(10)
    assert cluster.rtt.between(names[0], names[2], 95) == before
    ticks = 0
    while cluster.tick() != Change.RTT:
        clock.forward(1)
        ticks += 1
        assert ticks < 40
    assert ticks > 1
    after = cluster.rtt.between(names[0], names[2], 95)
    assert after[0] is not None
    assert before[0] is not None
    assert after[0] > before[0] + 20_000
    again, _ = large(clock)
    for name in names[:40]:
        again.apply_telemetry(telemetry(name, rtt_ms=dict.fromkeys(names[100:116], 90), interval_s=600))
    assert again.rtt.between(names[0], names[2], 95) == after
    assert all(cluster.tick() == Change.NONE for _ in range(3))


def test_nodes_that_come_and_go_in_a_large_cluster_keep_the_terms_of_the_others() -> None:
    clock = Clock()
    cluster, names = large(clock)
    known = cluster.rtt.between(names[1], names[2], 95)
    cluster.remove_node(names[0])
    cluster.apply_node(make_node("c-new", labels={str(Label.ZONE): "c"}))
    cluster.apply_node(make_node("b-new", labels={str(Label.ZONE): "b"}))
    assert cluster.rtt.between(names[1], names[2], 95) == known
    assert cluster.rtt.between(names[2], "b-new", 95)[1] == "estimated"
    assert cluster.rtt.between(names[2], "c-new", 95) == (None, "unknown")
    exported = cluster.rtt.latencies()
    for name in (names[1], "b-new", "c-new"):
        row = cluster.nodes.row_of[name]
        for which, percentile in ((0, 50), (1, 95)):
            np.testing.assert_array_equal(exported.row(row, which), cluster.rtt.from_node(name, percentile).rtt_us)


def test_a_row_that_is_known_costs_a_small_part_of_computing_it() -> None:
    cluster, names = large(Clock())
    cluster.rtt.from_node(names[0], 95)
    started = time.process_time()
    for name in names[:200]:
        cluster.rtt.from_node(name, 95)
    fresh_s = time.process_time() - started
    started = time.process_time()
    for name in names[:200]:
        cluster.rtt.from_node(name, 95)
    assert time.process_time() - started < fresh_s / 4


def test_a_new_reading_leaves_the_rows_of_others_as_they_are() -> None:
    cluster, names = large(Clock())
    before = {name: cluster.rtt.from_node(name, 95) for name in names[:4]}
    cluster.apply_telemetry(telemetry(names[0], rtt_ms={names[1]: 7}, interval_s=600))
    after = {name: cluster.rtt.from_node(name, 95) for name in names[:4]}
    assert [name for name in names[:4] if after[name] is not before[name]] == names[:2]
    assert cluster.rtt.between(names[0], names[1], 95)[1] == "measured"
