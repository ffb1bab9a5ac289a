"""Loads of `scripts/bench cycle` beside plain placing: latency rows, pods that wait unschedulable, and pods that must preempt others."""

import time
from collections.abc import Callable
from typing import Any, Final

import msgspec
import numpy as np
from tests.support.scheduling import default_profiles, make_node, make_pod, telemetry

from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.queue.queued_pod_info import Rejection

LOW_PER_NODE: Final = 4
SELECTOR: Final = {"matchLabels": {"color": "stuck"}}
NOWHERE: Final = {
    "topologyKey": "nowhere",
    "maxSkew": 1,
    "whenUnsatisfiable": "DoNotSchedule",
    "labelSelector": SELECTOR,
}
HOSTNAME: Final = {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": {"color": "blue"}}}
ZONE: Final = {**HOSTNAME, "topologyKey": str(Label.ZONE)}
PREEMPTORS: Final[dict[str, dict[str, Any]]] = {
    "amounts": {},
    "anti-affinity": {"affinity": {"podAntiAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [HOSTNAME]}}},
    "zone-spread": {"topologySpreadConstraints": [{**ZONE, "maxSkew": 5, "whenUnsatisfiable": "DoNotSchedule"}]},
}


def waiting(core: SchedulerCore, stuck: str, pods: int, make: Callable[[int], Any], *, wait: int) -> dict[str, Any]:
    """µs per decision and per event "bound" while `wait` refused pods wait, each with labels of its own."""
    for i in range(wait):
        fields = {"cpu": f"{1000 + i}"} if stuck == "too large" else {"topologySpreadConstraints": [NOWHERE]}
        pod = make_pod(f"stuck-{i}", labels={"color": "stuck", "ordinal": str(i)}, **fields)
        core.cluster.apply_pod(pod)
        core.queue.add(core.cluster.pod_info(pod))
    refusing = [_refuse(core) for _ in range(wait)]
    deciding, telling = [], []
    for i in range(pods):
        pod = make(i)
        core.cluster.apply_pod(pod)
        core.queue.add(core.cluster.pod_info(pod))
        started = time.perf_counter()
        (decision,) = core.schedule(core.queue.pop())
        core.queue.done(decision.pod.uid)
        decided = time.perf_counter()
        bound = msgspec.structs.replace(pod, spec=msgspec.structs.replace(pod.spec, node_name=str(decision.node)))
        core.queue.move(Event("pods", core.cluster.apply_pod(bound), pod, bound))
        telling.append(time.perf_counter() - decided)
        deciding.append(decided - started)
    found = {"refuse_us": _median_us(refusing), "decide_us": _median_us(deciding), "event_us": _median_us(telling)}
    return {"waiting": wait, "stuck": stuck, **found, "still": core.queue.pending()["unschedulable"]}


def _refuse(core: SchedulerCore) -> float:
    started = time.perf_counter()
    for decision in core.schedule(core.queue.pop()):
        if decision.queued is None or decision.placed:
            raise SystemExit(f"{decision.pod.key} was to be refused: {decision}")
        core.queue.requeue(decision.queued, Rejection(decision.rejected_by))
    return time.perf_counter() - started


def preempting(nodes: int, kind: str, pods: int, *, gone: bool = True) -> dict[str, Any]:
    """CPU in ms per attempt of pods that find every node full of four pods of lower priority.

    `gone`: victims go at once and the pod is placed; otherwise they terminate for longer than the run, and all pods before
    it are nominated.
    """
    core = _full(nodes)
    spent = []
    for i in range(pods):
        fields = {"cpu": "8", "memory": "100Mi", "priority": 1000, "labels": {"color": "blue"}, **PREEMPTORS[kind]}
        info = core.cluster.pod_info(make_pod(f"high-{i}", **fields))
        started = time.process_time()
        decision = core.schedule_one(info)
        spent.append(1e3 * (time.process_time() - started))
        if decision.plan is None:
            raise SystemExit(f"{info.key} found no victims: {decision.message}")
        core.cluster.nominations.nominate(info, decision.plan.node)
        for victim in decision.plan.victims:
            if gone:
                core.cluster.remove_pod(victim.pod)
            else:
                core.cluster.apply_pod(_terminating(victim.pod))
        if gone:
            core.schedule_one(info)
    found = {
        "first_ms": round(spent[0], 2),
        "p50_ms": _median(spent),
        "p99_ms": round(sorted(spent)[int(len(spent) * 0.99)], 2),
    }
    row = {"nodes": nodes, "preemptors": kind, "victims": "gone" if gone else "terminating"}
    return {**row, **found}


def _median(values: list[float]) -> float:
    return round(sorted(values)[len(values) // 2], 2)


def _terminating(pod: Pod) -> Pod:
    metadata = msgspec.structs.replace(pod.metadata, deletion_timestamp="2026-01-01T00:00:00Z")
    return msgspec.structs.replace(pod, metadata=metadata)


def _full(nodes: int) -> SchedulerCore:
    cluster = Cache(clock=time.monotonic)
    for i in range(nodes):
        cluster.apply_node(make_node(f"node-{i}", labels={str(Label.ZONE): f"zone-{i % 10}"}, cpu="32", memory="256Gi"))
    for i in range(LOW_PER_NODE * nodes):
        low = make_pod(f"low-{i}", node=f"node-{i % nodes}", labels={"color": "blue"}, cpu="8", memory="100Mi")
        low.status.start_time = f"2026-01-01T00:{i // 60 % 60:02d}:{i % 60:02d}Z"
        cluster.apply_pod(low)
    return SchedulerCore(cluster, default_profiles(), clock=time.monotonic)


def _median_us(seconds: list[float]) -> float:
    return round(1e6 * sorted(seconds)[len(seconds) // 2], 1) if seconds else 0.0


def round_trip_rows(core: SchedulerCore, *, asked: int = 500) -> dict[str, Any]:
    """CPU of the latency model: a row that is kept, a row that is computed, and the longest step of a fit to new readings.

    `x_pass`: the computed row in passes of one addition over all nodes, which is what the machine needs at least.
    """
    cluster, names = core.cluster, core.cluster.nodes.names
    rtt = cluster.rtt
    fit_us = spent_us(lambda: rtt.from_node(names[0], 95))
    kept_us = spent_us(lambda: [rtt.from_node(names[0], 95) for _ in range(1000)]) / 1000
    fresh_us = spent_us(lambda: [rtt.from_node(name, 95) for name in names[1:asked]]) / (asked - 1)
    column = np.arange(float(len(names)))
    pass_us = spent_us(lambda: [column + column for _ in range(1000)]) / 1000
    cluster.apply_telemetry(telemetry(names[0], rtt_ms=dict.fromkeys(names[1:17], 5.0)))
    steps_us = [spent_us(cluster.tick) for _ in range(40)]
    return {
        "nodes": len(names), "workload": "rtt row", "kept_us": round(kept_us, 2), "fresh_us": round(fresh_us, 1),
        "x_pass": round(fresh_us / pass_us, 1), "first_fit_ms": round(fit_us / 1000, 1), "longest_tick_ms": round(max(steps_us) / 1000, 1),
    }  # fmt: skip


def spent_us(work: Callable[[], object]) -> float:
    """CPU of this process."""
    before = time.process_time()
    work()
    return 1e6 * (time.process_time() - before)
