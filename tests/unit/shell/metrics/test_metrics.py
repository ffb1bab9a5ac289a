"""Metrics read when scraped: names, labels and limits."""

import msgspec
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from tests.support import apiobjects
from tests.support.scheduling import device_claim, make_core, make_info, make_node

from robotapp_claims.rules.objects import Claim
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo, Rejection
from robotapp_scheduler.shell.metrics.metrics import MOST_SERIES, AttemptResult, Metrics
from robotapp_scheduler.shell.process.collectors import DomainClaims

SECONDS = [0.001 * 2**step for step in range(15)]
UPSTREAM: dict[str, tuple[str, list[float]]] = {
    "schedule_attempts_total": ("counter", []),
    "scheduling_attempt_duration_seconds": ("histogram", SECONDS),
    "scheduling_algorithm_duration_seconds": ("histogram", SECONDS),
    "pod_scheduling_sli_duration_seconds": ("histogram", [0.01 * 2**step for step in range(20)]),
    "pod_scheduling_attempts": ("histogram", [1, 2, 4, 8, 16]),
    "framework_extension_point_duration_seconds": ("histogram", [0.0001 * 2**step for step in range(12)]),
    "plugin_execution_duration_seconds": ("histogram", [
        1e-05, 1.5000000000000002e-05, 2.2500000000000005e-05, 3.375000000000001e-05, 5.062500000000001e-05, 7.593750000000002e-05,
        0.00011390625000000003, 0.00017085937500000006, 0.0002562890625000001, 0.00038443359375000017, 0.0005766503906250003,
        0.0008649755859375004, 0.0012974633789062506, 0.0019461950683593758, 0.0029192926025390638, 0.004378938903808595,
        0.006568408355712893, 0.009852612533569338, 0.014778918800354007, 0.02216837820053101,
    ]),
    "permit_wait_duration_seconds": ("histogram", SECONDS),
    "preemption_victims": ("histogram", [1, 2, 4, 8, 16, 32, 64]),
    "preemption_attempts_total": ("counter", []),
}  # fmt: skip
"""Names, types and buckets of kube-scheduler 1.37.1; those read from the core are tested with it."""


def exposed(metrics: Metrics) -> str:
    return generate_latest(metrics.registry).decode()


def test_upstreams_names_types_and_buckets_are_there_before_anything_happened() -> None:
    metrics = Metrics(CollectorRegistry())
    text = exposed(metrics)
    assert "_created" not in text
    families = {family.name: family for family in metrics.registry.collect()}
    for name, (kind, buckets) in UPSTREAM.items():
        assert f"# TYPE scheduler_{name} {kind}" in text, name
        if buckets:
            found = metrics.registry._names_to_collectors[f"scheduler_{name}"]
            assert found.bounds == (*buckets, float("inf")), name  # type: ignore[attr-defined]
    assert "process_resident_memory_bytes" in families


def test_refused_and_failed_attempts_have_a_duration_too() -> None:
    metrics = Metrics(CollectorRegistry())
    for result in AttemptResult:
        metrics.attempted(result, "ours", 0.003)
    text = exposed(metrics)
    for result in ("scheduled", "unschedulable", "error"):
        bucket = f'attempt_duration_seconds_bucket{{le="0.004",profile="ours",result="{result}"}} 1.0'
        assert bucket in text, text
        assert f'schedule_attempts_total{{profile="ours",result="{result}"}} 1.0' in text


def test_attempts_beyond_upstreams_last_label_share_it() -> None:
    metrics, queued = Metrics(CollectorRegistry()), QueuedPodInfo(make_info(), 0.0)
    for attempts in (14, 15, 40):
        queued.attempts = attempts
        metrics.bound(queued, "ours", started_s=0.0, now_s=1.0)
    text = exposed(metrics)
    for label, count in (("14", 1), ("15+", 2)):
        assert f'scheduler_pod_scheduling_sli_duration_seconds_count{{attempts="{label}"}} {count}.0' in text


def test_claimed_domains_are_counted_by_pool_and_phase_as_the_watch_tells_them() -> None:
    counted = DomainClaims()

    def claim(phase: str, pool: str = "halls") -> Claim:
        found = apiobjects.claim(
            domain=apiobjects.domain(pool=pool),
        )
        return msgspec.convert({**found, "status": {"phase": phase}}, Claim)

    reserved, parked = claim("Reserved"), claim("Parked")
    counted.see(Event("robotclaims", Change.CLAIMS, None, reserved))
    counted.see(Event("robotclaims", Change.CLAIMS, reserved, parked))
    counted.see(Event("robotclaims", Change.CLAIMS, None, claim("Draining", "yard")))
    counted.see(Event("robotclaims", Change.CLAIMS, None, device_claim("n1", "can-can0", uid="u")))
    counted.see(Event("pods", Change.POD_ADDED, None, None))
    assert counted.counts() == {("halls", "Reserved"): 0, ("halls", "Parked"): 1, ("yard", "Draining"): 1}
    counted.see(Event("robotclaims", Change.CLAIMS, parked, None))
    assert counted.counts()["halls", "Parked"] == 0


def test_gauges_and_counters_kept_elsewhere_are_read_at_each_scrape() -> None:
    metrics, kept = Metrics(CollectorRegistry()), {("a", "b"): 1.0}
    metrics.watch_several("things", "Things", labels=("x", "y"), read=lambda: kept)
    metrics.count("events", "Events", labels=("x", "y"), read=lambda: kept)
    assert 'scheduler_things{x="a",y="b"} 1.0' in exposed(metrics)
    kept["c", "d"] = 2.0
    assert 'scheduler_things{x="c",y="d"} 2.0' in exposed(metrics)
    assert 'scheduler_events_total{x="c",y="d"} 2.0' in exposed(metrics)


def test_names_from_the_cluster_cannot_make_a_scrape_explode() -> None:
    metrics = Metrics(CollectorRegistry())
    many = {(f"label-{number}",): float(number) for number in range(MOST_SERIES + 500)}
    metrics.watch_several("many", "Many", labels=("name",), read=lambda: many)
    lines = [line for line in exposed(metrics).splitlines() if line.startswith("scheduler_many{")]
    assert len(lines) == MOST_SERIES
    assert f'scheduler_many{{name="label-{MOST_SERIES + 499}"}} {MOST_SERIES + 499}.0' in lines


def test_waiting_pods_are_counted_by_the_plugin_that_refused_them() -> None:
    queue = make_core(make_node("n")).queue
    for name in ("a", "b", "c"):
        queue.add(make_info(name))
    first, second, third = (queue.pop()[0] for _ in range(3))
    queue.requeue(first, Rejection(frozenset({"NodeResourcesFit", "TaintToleration"})))
    queue.requeue(second, Rejection(frozenset({"NodeResourcesFit"})))
    queue.requeue(third, Rejection())
    profile = first.info.scheduler_name
    assert queue.rejected() == {("NodeResourcesFit", profile): 2, ("TaintToleration", profile): 1}
    queue.add(make_info("gated", schedulingGates=[{"name": "example.com/gate"}]))
    assert queue.rejected()["SchedulingGates", profile] == 1
