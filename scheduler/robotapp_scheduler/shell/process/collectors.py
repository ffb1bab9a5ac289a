"""Metric collectors that read their values on each scrape, and cost nothing between scrapes; `DomainClaims` counts claims for them."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping

from robotapp_claims.rules.objects import Claim
from robotapp_client.api.client import ApiClient
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.shell.metrics.metrics import Metrics


class DomainClaims:
    """`see` every event; `counts` is for the metric, `held` for the search for a free id."""

    def __init__(self) -> None:
        self._claims: dict[str, Claim] = {}
        self._counts: Counter[tuple[str, ...]] = Counter()

    def __repr__(self) -> str:
        return f"<DomainClaims {dict(self._counts)}>"

    def see(self, event: Event) -> None:
        """Update the counts for an event of a claim; events of other resources are ignored."""
        if event.resource != "robotclaims":
            return
        for claim, step in ((event.old, -1), (event.new, 1)):
            if isinstance(claim, Claim) and claim.spec.domain is not None:
                self._counts[claim.spec.domain.pool, claim.status.phase] += step
                if step < 0:
                    self._claims.pop(claim.name, None)
                else:
                    self._claims[claim.name] = claim

    def held(self) -> Collection[Claim]:
        """All claims of domains, resting ones included."""
        return self._claims.values()

    def counts(self) -> Mapping[tuple[str, ...], float]:
        """Claims by (pool, phase); 0 where there were some."""
        return {key: float(count) for key, count in self._counts.items()}


def publish(
    metrics: Metrics,
    core: SchedulerCore,
    *,
    client: ApiClient,
    running: Running,
    simulations: Callable[[], Mapping[str, int]],
    domains: DomainClaims,
    staleness: Callable[[], Mapping[str, float]] = dict,
) -> None:
    """Register what the core, the client, the claims and the configuration count themselves."""
    metrics.watch("pending_pods", "Pods that wait, by queue", label="queue", read=lambda: _pending(core))
    metrics.watch("cache_size", "Objects in the cache", label="type", read=lambda: _cache_size(core))
    metrics.watch(
        "device_slots_free",
        "Devices on all nodes that nobody has claimed, by type",
        label="type",
        read=core.cluster.devices.free_by_type,
    )
    metrics.watch_several(
        "domain_claims", "Domains that are claimed, by pool and phase", labels=("pool", "phase"), read=domains.counts
    )
    metrics.watch(
        "watch_stale_seconds",
        "For how long changes of a resource may have gone unseen; 0 while its watch is open",
        label="resource",
        read=staleness,
    )
    metrics.watch_several("rtt_age_seconds", "Age of the oldest telemetry in use", labels=(), read=lambda: _age(core))
    metrics.watch_several(
        "unschedulable_pods",
        "Waiting pods, by the plugin that refused them last",
        labels=("plugin", "profile"),
        read=lambda: {key: float(count) for key, count in core.queue.rejected().items()},
    )
    metrics.count(
        "queue_incoming_pods",
        "Pods that entered a queue, by event",
        labels=("queue", "event"),
        read=lambda: {key: float(count) for key, count in core.queue.incoming.items()},
    )
    metrics.count(
        "plugin_decisions",
        "Pods a plugin let pass, refused, scored or skipped",
        labels=("plugin", "extension_point", "result"),
        read=lambda: {key: float(count) for key, count in core.decisions().items()},
    )
    metrics.count(
        "joint_plans",
        "Groups a plan was made for, by what became of it; every result but optimal and bounded is placed one by one",
        labels=("result",),
        read=lambda: {(result,): float(count) for result, count in core.plans.items()},
    )
    _publish_outside(metrics, client, running, simulations)


def _publish_outside(
    metrics: Metrics, client: ApiClient, running: Running, simulations: Callable[[], Mapping[str, int]]
) -> None:
    metrics.count(
        "api_requests",
        "Requests to the API server, by method and status; 0 is no answer",
        labels=("method", "status"),
        read=lambda: {(method, str(status)): n for (method, status), n in client.requests.items()},
    )
    metrics.count(
        "config_reloads",
        "Configurations given while running, by what became of them",
        labels=("result",),
        read=lambda: {(outcome,): float(count) for outcome, count in running.outcomes.items()},
    )
    metrics.count(
        "simulations",
        "Requests to /simulate, by HTTP status",
        labels=("status",),
        read=lambda: {(status,): float(count) for status, count in simulations().items()},
    )
    metrics.watch(
        "config_in_use",
        "1 for the digest of the configuration in use, 0 while a newer one that was given is refused",
        label="digest",
        read=lambda: {running.config.digest: 0.0 if running.refused else 1.0},
    )


def _pending(core: SchedulerCore) -> Mapping[str, float]:
    """As kube-scheduler 1.37 counts: `incomplete` are pods whose PodGroup does not exist."""
    known = core.cluster.pod_groups
    unseen = sum(
        1
        for queued in core.queue.gated()
        if queued.info.pod_group is not None and known.find(queued.info.pod_group) is None
    )
    queues = core.queue.pending()
    return {**queues, "gated": queues["gated"] - unseen, "incomplete": unseen, "pending": 0}


def _age(core: SchedulerCore) -> Mapping[tuple[str, ...], float]:
    age_s = core.cluster.rtt.oldest_age_s()
    return {} if age_s is None else {(): age_s}


def _cache_size(core: SchedulerCore) -> Mapping[str, float]:
    cluster = core.cluster
    assumed = sum(1 for pod in cluster.placed.values() if pod.assumed)
    return {"nodes": cluster.nodes.count, "pods": len(cluster.placed), "assumed_pods": assumed}
