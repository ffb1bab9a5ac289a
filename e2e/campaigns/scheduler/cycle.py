"""What one scheduling attempt costs the core, µs of CPU per pod: scripts/bench cycle [--nodes 5000] [--placed 30000]

No API server, no I/O: decode is done, the pod is in the queue; measured are pop, filters, scores, choice, assume and
the explain record. `classes` is the number of distinct pod shapes, interleaved; "each" makes every pod its own.
With --placed come the loads in which pods depend on each other, among that many running pods of 200 apps. --waiting N:
what a decision and an event cost while N refused pods wait, each with labels of its own. --preempting N: N pods that must preempt others.
Use ratios; absolute values belong to the machine and to what else runs on it.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from tests.support.scheduling import default_profiles, make_node, make_pod, telemetry

from campaigns.common.output import save
from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.core_v1 import Pod, Selecting
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


ZONES = 10
APPS = 200
COMPANY = ("anti-affinity", "zone-affinity", "zone-spread", "default-spread")
"""Workloads in which pods depend on each other."""


def build(nodes: int, placed: int = 0, *, service: bool = False) -> SchedulerCore:
    """Nodes of 32 CPU and 256 Gi in ten zones, agents that measure sixteen peers each; running pods, a third of them green."""
    cluster = Cache(clock=time.monotonic)
    for i in range(nodes):
        zone = {str(Label.ZONE): f"zone-{i % ZONES}", "disk": "ssd" if i % 3 else "hdd"}
        cluster.apply_node(make_node(f"node-{i}", labels=zone, cpu="32", memory="256Gi"))
    for i in range(nodes):
        peers = {f"node-{(i * 7 + k * 131) % nodes}": 2.0 + (k * 13) % 60 for k in range(16)}
        cluster.apply_telemetry(telemetry(f"node-{i}", rtt_ms=peers))
    for i in range(placed):
        labels = {"app": f"app-{i % APPS}", **({"color": "green"} if i % 3 == 0 else {})}
        cluster.apply_pod(
            make_pod(f"placed-{i}", node=f"node-{i * 7 % nodes}", labels=labels, cpu="100m", memory="100Mi")
        )
    if service:
        green = {"metadata": {"name": "green", "namespace": "default"}, "spec": {"selector": {"color": "green"}}}
        cluster.topology.apply_selecting("Service", msgspec.convert(green, Selecting))
    return SchedulerCore(cluster, default_profiles(), clock=time.monotonic)


def pod(index: int, classes: int, workload: str) -> Any:
    fields: dict[str, Any] = {"cpu": f"{100 + index % classes}m", "memory": "100Mi"}
    if workload == "rich":
        fields["nodeSelector"] = {"disk": "ssd"}
        fields["tolerations"] = [{"key": f"k{index % classes}", "operator": "Exists"}]
    if workload == "ros":
        policies = {"latency_budget": "40ms", "deadline": "80ms", "qos_class": "realtime"}
        master = {"master_node": f"node-{index % classes}", "preferred_zones": ["zone-1", "zone-2"]}
        fields["annotations"] = {
            str(Annotation.POLICIES): json.dumps(policies),
            str(Annotation.TOPOLOGY): json.dumps(master),
        }
    if workload in COMPANY:
        fields |= company(workload)
        # Other labels, as the pods of a StatefulSet have them: every rule about other pods sees another pod.
        fields["labels"] = {**fields["labels"], "ordinal": str(index % classes)}
    return make_pod(f"p{index}", **fields)


def company(workload: str) -> dict[str, Any]:
    """Fields of a pod that wants to be near others, or not."""
    color = "blue" if workload == "anti-affinity" else "green"
    selector = {"matchLabels": {"color": color}}
    term = {"topologyKey": str(Label.ZONE), "labelSelector": selector}
    near = {"preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 10, "podAffinityTerm": term}]}
    away = {"requiredDuringSchedulingIgnoredDuringExecution": [term | {"topologyKey": "kubernetes.io/hostname"}]}
    fields: dict[str, Any] = {"labels": {"color": color}}
    if workload == "anti-affinity":
        fields["affinity"] = {"podAntiAffinity": away}
    if workload == "zone-affinity":
        fields["affinity"] = {"podAffinity": near}
    if workload == "zone-spread":
        fields["topologySpreadConstraints"] = [{**term, "maxSkew": 5, "whenUnsatisfiable": "DoNotSchedule"}]
    return fields


def measure(nodes: int, classes: int, workload: str, pods: int, placed: int = 0) -> dict[str, Any]:
    core = build(nodes, placed, service=workload == "default-spread")
    made = [pod(i, classes, workload) for i in range(pods + 100)]
    started = time.process_time()
    for one in made:
        core.cluster.apply_pod(one)
        core.queue.add(core.cluster.pod_info(one))
    queued = time.process_time()
    spent: list[float] = []
    while batch := core.queue.pop():
        before = time.process_time()
        for decision in core.schedule(batch):
            if decision.node is None:
                raise SystemExit(f"{decision.pod.key} was refused: {decision.message}")
            core.queue.done(decision.pod.uid)
        spent.append(1e6 * (time.process_time() - before))
    steady = sorted(spent[100:])
    return {
        "nodes": nodes,
        "workload": workload,
        "classes": classes if classes < pods else "each",
        "add_us": round(1e6 * (queued - started) / len(made), 1),
        "mean_us": round(sum(steady) / len(steady), 1),
        "p50_us": round(steady[len(steady) // 2], 1),
        "p99_us": round(steady[int(len(steady) * 0.99)], 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, nargs="+", default=[1000, 5000])
    parser.add_argument("--pods", type=int, default=2000)
    parser.add_argument("--placed", type=int, default=0, help="running pods; adds the loads that look at them")
    parser.add_argument("--only", nargs="*", help="just these workloads")
    parser.add_argument("--waiting", type=int, default=0, help="refused pods that wait")
    parser.add_argument("--preempting", type=int, default=0, help="pods that must preempt others")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []

    def tell(row: dict[str, Any]) -> None:
        rows.append(row)
        print("  ".join(f"{key} {value!s:>7}" for key, value in row.items()), flush=True)

    for nodes in args.nodes:
        if args.only is None or "rtt" in args.only:
            tell(round_trip_rows(build(nodes)))
        for workload, classes in (
            ("basic", 1), ("basic", 20), ("basic", args.pods + 100), ("rich", 20), ("rich", args.pods + 100),
            ("ros", 20), ("ros", args.pods + 100),
            *((workload, classes) for workload in COMPANY if args.placed for classes in (1, 20, args.pods + 100)),
        ):  # fmt: skip
            if args.only is None or workload in args.only:
                tell(measure(nodes, classes, workload, args.pods, args.placed))
        for stuck, workload in (("too large", "basic"), ("spread", "anti-affinity"), ("spread", "zone-spread")):
            for wait in (0, args.waiting) if args.waiting else ():
                core = build(nodes, args.placed)
                row = waiting(core, stuck, args.pods, lambda i, workload=workload: pod(i, 1, workload), wait=wait)
                tell({"nodes": nodes, "workload": workload, **row})
        for kind in PREEMPTORS if args.preempting else ():
            for gone in (True, False):
                tell(preempting(nodes, kind, args.preempting, gone=gone))
    save(args.json, rows)


if __name__ == "__main__":
    main()
