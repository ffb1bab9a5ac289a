"""Metrics under controller-runtime's names, so that existing dashboards and alerts fit."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector

from robotapp_claims.rules.pools import fullness, overlaps_of
from robotapp_client import ApiClient
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.watch.cache import Cache

CONTROLLER = "robotapp"


class Metrics:
    """One registry per process; labels are bounded (kinds of work, results, phases)."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        labels = ["controller"]
        self._total = Counter(
            "controller_runtime_reconcile", "Reconciliations by result", [*labels, "result"], registry=self.registry
        )
        self._errors = Counter(
            "controller_runtime_reconcile_errors",
            "Reconciliations that ended in an error",
            labels,
            registry=self.registry,
        )
        self._panics = Counter(
            "controller_runtime_reconcile_panics", "Bugs met while reconciling", labels, registry=self.registry
        )
        self._time = Histogram(
            "controller_runtime_reconcile_time_seconds", "Duration of a reconciliation", labels, registry=self.registry
        )
        self._active = Gauge(
            "controller_runtime_active_workers", "Keys being worked on", labels, registry=self.registry
        )
        self._waited = Histogram(
            "workqueue_queue_duration_seconds", "Wait of a key beyond its due time", ["name"], registry=self.registry
        )
        self._worked = Histogram(
            "workqueue_work_duration_seconds", "Duration of work on a key", ["name"], registry=self.registry
        )
        self._series: dict[str, tuple[Histogram, Gauge, Histogram, Histogram]] = {}

    def watch(self, queue: Queue, cache: Cache, client: ApiClient) -> None:
        """Read gauges from their owners at scrape time."""
        gauges: list[tuple[str, str, Callable[[], float]]] = [
            ("workqueue_depth", "Keys waiting", lambda: queue.depth),
            ("workqueue_adds_total", "Keys added", lambda: queue.adds),
            ("workqueue_retries_total", "Keys put back after a failure", lambda: queue.retries),
            ("robotapp_operator_apps", "RobotApps known", lambda: len(cache.apps)),
            ("robotapp_operator_instances", "RobotAppInstances known", lambda: len(cache.instance_object_named)),
            ("rest_client_requests_total", "Requests to the API server", client.requests.total),
        ]
        for name, text, read in gauges:
            Gauge(name, text, registry=self.registry).set_function(read)
        self.registry.register(PoolCollector(cache))

    def watch_staleness(self, read: Callable[[], Mapping[str, float]]) -> None:
        """Publishes for each watched resource for how long its changes may have gone unseen."""
        stale = Gauge(
            "robotapp_operator_watch_stale_seconds",
            "For how long changes of a resource may have gone unseen; 0 while its watch is open",
            ["resource"],
            registry=self.registry,
        )
        for resource in read():
            stale.labels(resource).set_function(partial(_read_one, read, resource))

    @contextlib.contextmanager
    def reconciling(self, work: str, late_s: float) -> Iterator[Callable[[str], None]]:
        """Times one reconciliation; call the yielded function with its result."""
        name = f"{CONTROLLER}-{work}"
        started = time.perf_counter()
        waited, active, took, worked = self._of_work(name)
        waited.observe(late_s)
        active.inc()

        def result(outcome: str) -> None:
            self._total.labels(name, outcome).inc()
            if outcome == "error":
                self._errors.labels(name).inc()

        try:
            yield result
        finally:
            active.dec()
            elapsed = time.perf_counter() - started
            took.observe(elapsed)
            worked.observe(elapsed)

    def _of_work(self, name: str) -> tuple[Histogram, Gauge, Histogram, Histogram]:
        """The series of one kind of work: looking one up costs more than adding to it."""
        found = self._series.get(name)
        if found is None:
            waited, active = self._waited.labels(name), self._active.labels(name)
            found = self._series[name] = waited, active, self._time.labels(name), self._worked.labels(name)
        return found

    def bug(self) -> None:
        self._panics.labels(CONTROLLER).inc()

    def render(self) -> bytes:
        return generate_latest(self.registry)


def _read_one(read: Callable[[], Mapping[str, float]], resource: str) -> float:
    return read()[resource]


class PoolCollector(Collector):
    """How full each DomainPool is, counted at scrape time."""

    def __init__(self, cache: Cache) -> None:
        self._cache = cache

    def describe(self) -> list[Metric]:
        return list(self._families())

    def collect(self) -> list[Metric]:
        ids, claimed, overlapping = families = self._families()
        pools = list(self._cache.pools.values())
        for pool in pools:
            name, state = pool.metadata.name, fullness(pool, self._cache.all_claims())
            ids.add_metric([name], state.capacity)
            claimed.add_metric([name], state.fullest)
            overlapping.add_metric([name], bool(overlaps_of(pool, pools)))
        return list(families)

    @staticmethod
    def _families() -> tuple[GaugeMetricFamily, GaugeMetricFamily, GaugeMetricFamily]:
        return (
            GaugeMetricFamily(
                "robotapp_operator_pool_ids", "Ids a pool gives, per place of its scope", labels=["pool"]
            ),
            GaugeMetricFamily(
                "robotapp_operator_pool_claimed_ids",
                "Ids claimed, resting ones included, in the fullest place of the pool's scope",
                labels=["pool"],
            ),
            GaugeMetricFamily(
                "robotapp_operator_pool_overlapping", "1 for a pool whose ids another one lists, too", labels=["pool"]
            ),
        )
