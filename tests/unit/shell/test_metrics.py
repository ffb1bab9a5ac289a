"""Metrics read when scraped: names, labels and limits."""

from prometheus_client import CollectorRegistry
from prometheus_client.exposition import generate_latest
from tests.support.scheduling import make_core, make_info, make_node

from robotapp_scheduler.core.queued import Rejection
from robotapp_scheduler.shell.metrics import MOST_SERIES, Metrics

UPSTREAM = (
    "schedule_attempts_total",
    "scheduling_attempt_duration_seconds",
    "scheduling_algorithm_duration_seconds",
    "pod_scheduling_sli_duration_seconds",
    "pod_scheduling_attempts",
    "framework_extension_point_duration_seconds",
    "plugin_execution_duration_seconds",
    "preemption_victims",
    "preemption_attempts_total",
)


def exposed(metrics: Metrics) -> str:
    return generate_latest(metrics.registry).decode()


def test_upstreams_names_are_there_before_anything_happened() -> None:
    text = exposed(Metrics(CollectorRegistry()))
    for name in UPSTREAM:
        assert f"# TYPE scheduler_{name} " in text, name


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
    assert queue.refused() == {("NodeResourcesFit", profile): 2, ("TaintToleration", profile): 1}
