"""Estimates of unmeasured pairs on synthetic networks whose true round trips are known."""

from collections.abc import Mapping
from dataclasses import replace
from random import Random
from statistics import median
from typing import TypeVar

from hypothesis import given, settings
from hypothesis import strategies as st
from tests.property.core.ros.latency_networks import Network, cluster_of, network
from tests.support.scheduling import Clock, telemetry
from tests.support.seeds import count_examples

from robotapp_scheduler.core.cache.cache import Cache

T = TypeVar("T")
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, *, robots: float | None = None) -> Network:
    random = Random(seed)
    share = random.choice((0.2, 0.5, 0.8)) if robots is None else robots
    return network(random, nodes=random.randint(30, 60), zones=random.randint(1, 4), robots=share)


def estimates_ms(cluster: Cache, net: Network, percentile: int = 50) -> dict[tuple[str, str], float]:
    found = {}
    for pair in net.unmeasured():
        time_us, source = cluster.rtt.between(*pair, percentile)
        if time_us is not None:
            assert source == "estimated"
            found[pair] = time_us / 1000
    return found


def shuffled(random: Random, items: Mapping[str, T]) -> dict[str, T]:
    return dict(random.sample(list(items.items()), len(items)))


def by_zones_alone_ms(net: Network) -> dict[tuple[str, str], float]:
    """What the median of the pairs measured between two zones says."""
    samples: dict[frozenset[str], list[float]] = {}
    for name, peers in net.readings.items():
        for peer, ms in peers.items():
            samples.setdefault(frozenset((net.zone[name], net.zone[peer])), []).append(ms)
    zones = {pair: frozenset(net.zone[end] for end in pair) for pair in net.unmeasured()}
    return {pair: median(samples[both]) for pair, both in zones.items() if both in samples}


def errors(net: Network, found: dict[tuple[str, str], float]) -> list[float]:
    """Relative errors of pairs with a robot."""
    return [
        abs(ms - net.true_ms(*pair)) / net.true_ms(*pair)
        for pair, ms in found.items()
        if pair[0] in net.robots or pair[1] in net.robots
    ]


@settings(max_examples=count_examples(40))
@given(seeds)
def test_a_typical_estimate_of_a_robot_is_within_a_fifth(seed: int) -> None:
    net = drawn(seed)
    assert median(errors(net, estimates_ms(cluster_of(net), net))) < 0.2


@settings(max_examples=count_examples(10))
@given(st.lists(seeds, min_size=4, max_size=4, unique=True))
def test_a_typical_estimate_of_a_robot_is_off_by_less_than_half_of_what_zones_alone_give(several: list[int]) -> None:
    """Over several networks: in a single one whose robots are alike, both can be off by no more than the readings are."""
    nets = [drawn(seed) for seed in several]
    ours = [error for net in nets for error in errors(net, estimates_ms(cluster_of(net), net))]
    zones = [error for net in nets for error in errors(net, by_zones_alone_ms(net))]
    assert median(ours) < median(zones) / 2


@settings(max_examples=count_examples(20))
@given(seeds, st.sampled_from((0.5, 2.0, 8.0)), st.sampled_from((50, 95)))
def test_when_all_times_are_longer_all_estimates_are(seed: int, factor: float, percentile: int) -> None:
    """Exactly so: the factors are powers of two and all times whole microseconds before and after, so nothing is rounded
    otherwise. No margin would do instead: a fit may turn a microsecond in one reading into many in an estimate.
    """
    net = drawn(seed)
    once, longer = (estimates_ms(cluster_of(net, scale=scale), net, percentile) for scale in (1.0, factor))
    assert longer == {pair: factor * ms for pair, ms in once.items()}


@settings(max_examples=count_examples(20))
@given(seeds, st.sampled_from((50, 95)))
def test_no_order_matters(seed: int, percentile: int) -> None:
    """Neither that in which nodes come, nor that of the agents, nor that of the peers in a report."""
    net, random = drawn(seed), Random(seed)
    other = replace(
        net,
        zone=shuffled(random, net.zone),
        readings={name: shuffled(random, peers) for name, peers in net.readings.items()},
    )
    agents = list(shuffled(random, net.readings))
    first = estimates_ms(cluster_of(net), net, percentile)
    assert estimates_ms(cluster_of(other, order=agents), net, percentile) == first


@settings(max_examples=count_examples(20))
@given(seeds)
def test_what_was_estimated_before_does_not_matter(seed: int) -> None:
    """Terms are fitted to the readings alone, however often that was done on the way."""
    net, clock = drawn(seed), Clock()
    cluster = cluster_of(net, order=[min(net.readings)], clock=clock)
    for name, peers in net.readings.items():
        cluster.apply_telemetry(telemetry(name, rtt_ms=peers))
        clock.forward(0.3)
        cluster.rtt.between("n0", "n1", 95)
    clock.forward(1.0)
    assert estimates_ms(cluster, net) == estimates_ms(cluster_of(net), net)


@settings(max_examples=count_examples(20))
@given(seeds)
def test_an_agent_that_is_gone_leaves_no_evidence(seed: int) -> None:
    net, clock = drawn(seed), Clock()
    cluster = cluster_of(net, clock=clock)
    estimates_ms(cluster, net)
    gone = Random(seed).sample(sorted(net.readings), len(net.readings) // 2)
    for name in gone:
        cluster.remove_telemetry(telemetry(name))
    clock.forward(1.0)
    left = Network(net.zone, net.access_ms, net.path_ms, {n: {} if n in gone else p for n, p in net.readings.items()})
    assert estimates_ms(cluster, left) == estimates_ms(cluster_of(left), left)


@settings(max_examples=count_examples(20))
@given(seeds)
def test_estimates_are_the_same_from_both_ends_and_a_p95_is_never_below_the_p50(seed: int) -> None:
    net = drawn(seed)
    cluster = cluster_of(net)
    for one, other in net.unmeasured():
        assert cluster.rtt.between(one, other, 50) == cluster.rtt.between(other, one, 50)
        half, most = (cluster.rtt.between(one, other, percentile)[0] for percentile in (50, 95))
        assert (half is None) == (most is None)
        assert half is None or most is None or 0 < half <= most
