"""Metrics under kube-scheduler's names and buckets, so that existing dashboards and alerts keep working, plus our own.

Label children are looked up once and kept: a metric on the hot path costs a quarter of a microsecond.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import accumulate, repeat
from operator import mul

from prometheus_client import CollectorRegistry, Counter, ProcessCollector, disable_created_metrics
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from robotapp_scheduler.core.queue.queued_pod_info import QueuedPodInfo
from robotapp_scheduler.shell.metrics.histogram import Histogram, Tally

# kube-scheduler has none: a counter's `_created` would be a gauge that no dashboard uses.
disable_created_metrics()  # type: ignore[no-untyped-call]  # the library declares no type
MOST_ATTEMPTS = 15
"""Upstream's cap of the `attempts` label."""


class AttemptResult(StrEnum):
    """Values of the `result` label of an attempt."""

    SCHEDULED = "scheduled"
    UNSCHEDULABLE = "unschedulable"
    ERROR = "error"


def doubling(start: float, factor: float, count: int) -> list[float]:
    """Multiplied step by step, as upstream's are: a power differs in the last digit, and `le` would be another text."""
    return list(accumulate(repeat(factor, count - 1), mul, initial=start))


class Metrics:
    """All metrics of one process, on a registry of its own."""

    def __init__(self, registry: CollectorRegistry | None = None) -> None:
        self.registry = registry or CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.attempt_s = self._histogram(
            "scheduling_attempt_duration_seconds",
            "Attempt from the decision to the bind's answer, or to the refusal",
            labels=["result", "profile"],
            buckets=doubling(0.001, 2, 15),
        )
        self.count(  # every attempt has a duration
            "schedule_attempts", "Attempts by result", labels=("result", "profile"), read=self.attempt_s.counts
        )
        self.algorithm_s = self._histogram(
            "scheduling_algorithm_duration_seconds", "The decision alone", buckets=doubling(0.001, 2, 15)
        )
        self.sli_s = self._histogram(
            "pod_scheduling_sli_duration_seconds",
            "First arrival in the queue to bound, all attempts together",
            labels=["attempts"],
            buckets=doubling(0.01, 2, 20),
        )
        self.pod_attempts = self._histogram(
            "pod_scheduling_attempts", "Attempts until a pod was bound", buckets=doubling(1, 2, 5)
        )
        self._attempts = self.pod_attempts.labels()
        self._points()
        self._preemption()
        self.node_rejections = self._counter(
            "node_rejections", "Pods of ours that a kubelet refused after they were bound", ["reason"]
        )
        self.poison_objects = self._counter("poison_objects", "Objects that could not be taken over", ["resource"])
        self.bind_conflicts = self._counter("bind_conflicts", "Binds refused with a conflict", [])

    def _points(self) -> None:
        self.extension_point_s = self._histogram(
            "framework_extension_point_duration_seconds",
            "One extension point of one cycle",
            labels=["extension_point", "status", "profile"],
            buckets=doubling(0.0001, 2, 12),
        )
        self.plugin_s = self._histogram(
            "plugin_execution_duration_seconds",
            "One hook of one plugin over all nodes it was called for",
            labels=["plugin", "extension_point", "status"],
            buckets=doubling(0.00001, 1.5, 20),
        )
        self.permit_wait_s = self._histogram(
            "permit_wait_duration_seconds",
            "Placed pods that waited for a permission to be bound: an app's for the claim of its domain",
            labels=["result"],
            buckets=doubling(0.001, 2, 15),
        )

    def _preemption(self) -> None:
        self.preemption_attempts = self._counter("preemption_attempts", "Searches for pods that could make room", [])
        self.preemption_victims = self._histogram(
            "preemption_victims", "Pods chosen to make room, per preemption", buckets=doubling(1, 2, 7)
        )
        self.preemption_violations = self._counter(
            "preemption_pdb_violations", "Disruption budgets broken by chosen pods", []
        )
        self.preemption_s = self._histogram(
            "preemption_execution_duration_seconds",
            "From the decision to the last accepted deletion",
            labels=["result"],
            buckets=doubling(0.01, 2, 20),
        )
        self._scheduled: dict[str, Tally] = {}
        self._bound: dict[int, Tally] = {}

    def attempted(self, result: AttemptResult, profile: str, seconds: float) -> None:
        """An attempt has ended."""
        self.attempt_s.labels(result, profile).observe(seconds)

    def bound(self, queued: QueuedPodInfo, profile: str, *, started_s: float, now_s: float) -> None:
        """A pod got its node."""
        scheduled = self._scheduled.get(profile)
        if scheduled is None:
            scheduled = self._scheduled[profile] = self.attempt_s.labels(AttemptResult.SCHEDULED, profile)
        scheduled.observe(now_s - started_s)
        attempts = min(queued.attempts, MOST_ATTEMPTS)
        sli_s = self._bound.get(attempts)
        if sli_s is None:
            word = str(attempts) if attempts < MOST_ATTEMPTS else f"{MOST_ATTEMPTS}+"
            sli_s = self._bound[attempts] = self.sli_s.labels(word)
        sli_s.observe(now_s - queued.first_seen_s)
        self._attempts.observe(queued.attempts)

    def preempted(self, victims: int, *, violations: int) -> None:
        """A preemption was decided."""
        self.preemption_victims.observe(victims)
        self.preemption_violations.inc(violations)

    def watch(self, name: str, text: str, *, label: str, read: Callable[[], Mapping[str, float]]) -> None:
        """A gauge that is read when scraped, e.g. `pending_pods{queue}`: costs nothing between scrapes."""
        self.watch_several(name, text, labels=(label,), read=lambda: {(key,): value for key, value in read().items()})

    def watch_several(
        self, name: str, text: str, *, labels: Sequence[str], read: Callable[[], Mapping[tuple[str, ...], float]]
    ) -> None:
        """The same with several labels."""
        self.registry.register(_Kept(GaugeMetricFamily(f"scheduler_{name}", text, labels=list(labels)), read))

    def count(
        self, name: str, text: str, *, labels: Sequence[str], read: Callable[[], Mapping[tuple[str, ...], float]]
    ) -> None:
        """A counter kept elsewhere (the pure core counts in dictionaries), read when scraped."""
        self.registry.register(_Kept(CounterMetricFamily(f"scheduler_{name}", text, labels=list(labels)), read))

    def _counter(self, name: str, text: str, labels: list[str]) -> Counter:
        return Counter(f"scheduler_{name}", text, labels, registry=self.registry)

    def _histogram(self, name: str, text: str, *, buckets: list[float], labels: list[str] | None = None) -> Histogram:
        return Histogram(f"scheduler_{name}", text, labels=labels or (), buckets=buckets, registry=self.registry)


MOST_SERIES = 2000
"""Label values come from names in the cluster: beyond this many the largest series are given, so that no scrape explodes."""


class _Kept(Collector):
    """A family filled when scraped."""

    def __init__(
        self,
        family: GaugeMetricFamily | CounterMetricFamily,
        read: Callable[[], Mapping[tuple[str, ...], float]],
    ) -> None:
        self._family, self._read = family, read

    def describe(self) -> list[Metric]:
        return [self._family]

    def collect(self) -> list[Metric]:
        found = list(self._read().items())
        if len(found) > MOST_SERIES:
            found = sorted(found, key=lambda entry: -entry[1])[:MOST_SERIES]
        self._family.samples = []
        for values, number in found:
            self._family.add_metric(values, number)
        return [self._family]
