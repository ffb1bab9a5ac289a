"""Campaigns without a cluster: the product against the scalar reference, and with ROS plugins against without.

The families take turns at the centre of a case. A case is named by seed and number, so that `--seed S --case N` shows it again.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from tests.support.scheduling import (
    Clock,
    app_object,
    chain,
    default_profiles,
    device_claim,
    make_cluster,
    member_pod,
    telemetry,
    to_pod,
)

from campaigns.cluster_cases import FAMILIES, Case, seeded_case
from campaigns.cluster_cases.shrinking import shrunk
from campaigns.parity.report import Report
from campaigns.parity.verdict import Verdict
from campaigns.reference_scheduler.comparison import differences, feed
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.framework.profiles import PluginRef, PluginSet, Profile, ProfileSpec
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.registry import ROS

Json = dict[str, Any]
PLAIN: Final = PluginSet(enabled=(PluginRef("PrioritySort"), PluginRef("DefaultBinder")), disabled=ROS)
"""kube-scheduler's plugins and nothing else."""
COMPONENTS: Final = ("driver", "planner")
CLOSED: Final = {"robotics.io/allowed-namespaces": "another"}
POLICIES: Final = {"scheduler.robotics.io/policies": '{"latency_budget": "30ms", "qos_class": "realtime"}'}


def profiles(plugins: Mapping[str, PluginSet]) -> dict[str, Profile]:
    return default_profiles([ProfileSpec(SCHEDULER_NAME, plugins=plugins)])


def both(case: Case) -> tuple[SchedulerCore, SchedulerCore]:
    """(with all plugins, with kube-scheduler's alone), each with a cluster of its own."""
    return _core(case, profiles({})), _core(case, profiles({"multiPoint": PLAIN}))


def decided(core: SchedulerCore, case: Case) -> Json:
    """Everything a decision consists of, per node what refused it or its total."""
    pod = PodInfo(to_pod(case.pod))
    core.cluster.nominations.see(pod)
    found = core.schedule_one(pod, assume=False)
    engine = core.runner(SCHEDULER_NAME)
    _, evaluation = core.consider(pod, engine)
    nodes: Json = {}
    if evaluation is not None:
        totals = evaluation.totals
        for position, code in enumerate(evaluation.reason.tolist()):
            name = engine.name_of(evaluation, position)
            reason = evaluation.reasons.values[code] if code > 0 else None
            total = int(totals[position]) if code == 0 and evaluation.feasible > 1 else 0
            nodes[name] = (reason.plugin, sorted(reason.texts)) if reason is not None else total
    return {
        "code": found.code,
        "node": found.node,
        "message": found.message,
        "reason": found.reason,
        "rejected by": found.rejected_by,
        "nominated": found.nominate,
        "victims": [victim.uid for victim in found.plan.victims] if found.plan is not None else [],
        "volumes": found.volumes,
        "grants": found.grants,
        "total": found.total,
        "nodes": nodes,
        "gate": core._gate(pod),
    }


def _core(case: Case, with_profiles: dict[str, Profile]) -> SchedulerCore:
    clock = Clock()
    core = SchedulerCore(make_cluster(clock=clock), with_profiles, clock=clock)
    objects = case.cluster.objects()
    for kind in ("Node", *(kind for kind in objects if kind != "Node")):
        for at, item in enumerate(objects[kind]):
            annotated = kind == "Pod" and at % 2 and item["spec"].get("nodeName")
            closed = kind == "Node" and at % 2
            feed(core, kind, _annotated(item, POLICIES if annotated else CLOSED if closed else {}))
    _robots(core.cluster, [node["metadata"]["name"] for node in case.cluster.nodes])
    return core


def _robots(cluster: Cache, nodes: list[str]) -> None:
    """Telemetry of every node, an app whose components run there, and their devices."""
    components: list[Json] = [{"name": name} for name in COMPONENTS]
    edge = {"from": COMPONENTS[0], "to": COMPONENTS[1], "topic": "/scan", "latency": {"budget": "20ms"}}
    cluster.apply_app(app_object(*components, edges=[edge]))
    for at, name in enumerate(nodes):
        rtt_ms = {peer: 1.0 + 7 * abs(at - other) for other, peer in enumerate(nodes) if peer != name}
        device = {"id": "can-can0", "type": "can"}
        cluster.apply_telemetry(telemetry(name, rtt_ms=rtt_ms, devices=[device], load={"cpuPercent": 90 - 10 * at}))
        cluster.apply_claim(device_claim(name, "can-can0", uid="app-1", component=COMPONENTS[0]))
    for component, node in zip(COMPONENTS, nodes, strict=False):
        for owned in chain(component):
            cluster.apply_owner(owned)
        cluster.apply_pod(member_pod(component, node=node, cpu=None, memory=None, namespace="robots"))


def _annotated(item: Json, annotations: Json) -> Json:
    meta = item["metadata"]
    return (
        {**item, "metadata": {**meta, "annotations": meta.get("annotations", {}) | annotations}}
        if annotations
        else item
    )


ATTEMPTS = 1500
"""Cases tried to make one that differs smaller."""
Say = Callable[[str], None]


def compare_with_reference(*, cases: int, seed: str, say: Say) -> Report:
    """Compares the product with `e2e/campaigns/reference_scheduler`; the first case that differs is made small."""

    def compare(report: Report, number: int, case: Case) -> None:
        report.take(case)
        if unequal := judge(case):
            objects = case.objects if report.found else shrink(case).objects
            report.differs(
                case, {"number": number, "families": case.families, "differences": unequal, "objects": objects}
            )

    return _run_cases(compare, cases=cases, seed=seed, say=say)


def compare_without_ros_plugins(*, cases: int, seed: str, say: Say) -> Report:
    """Compares all plugins with kube-scheduler's alone, for pods without ROS fields in a cluster of robots."""

    def compare(report: Report, number: int, case: Case) -> None:
        with_ros, without = (decided(core, case) for core in both(case))
        totals = {name: {"total": total} for name, total in without["nodes"].items() if isinstance(total, int)}
        report.take(case, Verdict(without["node"] or "", without["message"], totals if without["total"] else {}))
        unequal = [
            f"{key}: {with_ros[key]} with, {value} without" for key, value in without.items() if with_ros[key] != value
        ]
        if unequal:
            names = {"number": number, "families": case.families}
            report.differs(case, {**names, "differences": unequal, "objects": case.objects})

    return _run_cases(compare, cases=cases, seed=seed, say=say)


def describe_case(*, seed: str, number: int) -> str:
    """Returns a single case of a campaign with its differences, small if it differs."""
    case = seeded_case(seed, number=number, families=list(FAMILIES))
    if judge(case):
        case = shrink(case)
    lines = [f"families: {', '.join(case.families)}", *(f"- {text}" for text in judge(case) or ["no difference"])]
    return "\n".join([*lines, *(json.dumps(item) for item in case.objects)])


def judge(case: Case) -> list[str]:
    """Returns the differences; a crash of the product is one, and must not end the campaign."""
    try:
        return differences(case)
    except Exception as error:  # noqa: BLE001 - whatever the product raises is the finding
        return [f"{type(error).__name__}: {error}"]


def shrink(case: Case) -> Case:
    """Returns the smallest case found whose first difference is of the same kind: one that lacks what an API server demands
    fails in another way."""
    kind = _kind_of(judge(case))
    objects = shrunk(
        case.objects, lambda items: _kind_of(judge(replace(case, objects=items))) == kind, attempts=ATTEMPTS
    )
    return replace(case, objects=objects)


def _kind_of(unequal: list[str]) -> str:
    return unequal[0].partition(":")[0] if unequal else ""


def _run_cases(compare: Callable[[Report, int, Case], None], *, cases: int, seed: str, say: Say) -> Report:
    report = Report(seed)
    started_s = time.monotonic()
    for number in range(cases):
        compare(report, number, seeded_case(seed, number=number, families=list(FAMILIES)))
        if number % 1000 == 999:
            say(f"{number + 1}/{cases} cases, {len(report.found)} differences")
    report.seconds = time.monotonic() - started_s
    return report
