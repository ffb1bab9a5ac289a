"""Topics to the same pods are looked at together by the plugins of latency: the answer is that of each topic alone."""

from functools import reduce

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduling import make_cluster, make_info, make_node, telemetry

from robotapp_scheduler.core.api.ros import Endpoint, RosContext
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import Verdict
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.latency_filter import LatencyFilter, LatencyFilterArgs
from robotapp_scheduler.plugins.ros.latency_score import LatencyScore

NAMES = ("n0", "n1", "n2", "n3")
ENDPOINTS = st.builds(
    Endpoint,
    what=st.sampled_from(["/a to x", "/b to x", "/c to y"]),
    nodes=st.sampled_from([("n0",), ("n1",), ("n0", "n1")]),
    budget_us=st.sampled_from([None, 1_000, 5_000, 20_000, 60_000]),
    percentile=st.sampled_from([50, 95]),
    required=st.booleans(),
)
TIMES = st.dictionaries(st.sampled_from(NAMES[1:]), st.sampled_from([0.5, 4.0, 15.0, 50.0, 200.0]))


def cluster_of(times_ms: dict[str, float], lost: set[str]) -> Cache:
    cluster = make_cluster(*(make_node(name) for name in NAMES))
    cluster.apply_telemetry(telemetry("n0", rtt_ms=times_ms, lost=sorted(lost - set(times_ms))))
    return cluster


def pod(*endpoints: Endpoint) -> PodInfo:
    info = make_info("p")
    info.ros = RosContext(endpoints=endpoints)
    return info


@given(st.lists(ENDPOINTS, min_size=1, max_size=8), TIMES, st.sets(st.sampled_from(NAMES[2:])), st.booleans())
def test_a_node_passes_where_it_passes_for_each_topic_and_is_worth_what_it_is_for_the_worst(
    endpoints: list[Endpoint], times_ms: dict[str, float], lost: set[str], deny: bool
) -> None:
    nodes = Snapshot(cluster_of(times_ms, lost))
    plugin = LatencyFilter(LatencyFilterArgs(unknown="Deny" if deny else "Allow"))

    def mask(*these: Endpoint) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        verdict = plugin.filter(pod(*these), nodes)
        assert isinstance(verdict, Verdict)
        return verdict.mask

    assert mask(*endpoints).tolist() == reduce(np.logical_and, (mask(each) for each in endpoints)).tolist()
    with_budget = [each for each in endpoints if each.budget_us]
    if with_budget:
        alone = [LatencyScore().score(pod(each), nodes) for each in with_budget]
        assert np.array_equal(
            np.asarray(LatencyScore().score(pod(*endpoints), nodes)), reduce(np.minimum, map(np.asarray, alone))
        )
