"""One topology placed by our scheduler, and by kube-scheduler's rules without and with hand-written affinity."""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from tests.support.scheduler.pod_groups import arrive, run
from tests.support.scheduling import app_object, chain, make_core, make_node, make_pod, member_pod, telemetry

from campaigns.divergence.topology import P95, Part, Topology
from robotapp_api.model.names import Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.joint.solve import solve
from robotapp_scheduler.shell.planner.planner import AT_ONCE, IN_WORKER, SMALL

Json = dict[str, Any]
Where = dict[str, str]
"""Node by component, of those that are placed."""


def ours(topology: Topology) -> Where:
    """The app planned whole as the scheduler and its worker plan it, by CPU time: another process slows nothing."""
    core = _cluster(topology)
    for machine in topology.machines:
        rtt_ms = {other: us / 1000 for (name, other), us in topology.p50_us.items() if name == machine.name}
        core.cluster.apply_telemetry(
            telemetry(machine.name, rtt_ms=rtt_ms, p95_ms={peer: P95 * ms for peer, ms in rtt_ms.items()})
        )
    edges: list[Json] = [
        {"topic": f"/t{i}", "from": wire.start, "to": wire.end, "latency": {"budget": f"{wire.budget_us}us"}}
        for i, wire in enumerate(topology.wires)
    ]
    core.cluster.apply_app(app_object(*({"name": part.name} for part in topology.parts), edges=edges))
    for part in topology.parts:
        for owned in chain(part.name):
            core.cluster.apply_owner(owned)
    arrive(core, *(member_pod(part.name, **_spec(part)) for part in topology.parts))
    batch = core.queue.pop()
    joint = core.joint_problem_of(batch)
    placement = None
    if joint is not None:
        problem = joint.problem
        small = problem.pods * problem.rows * len(problem.edges) <= SMALL
        placement = placement_of(joint, solve(problem, AT_ONCE if small else IN_WORKER, time.process_time))
    decisions = core.schedule(batch, placement=placement)
    return {d.pod.labels[Label.COMPONENT]: d.node for d in decisions if d.node is not None}


def kube(topology: Topology) -> Where:
    """Pods without ROS fields, one after the other: that is kube-scheduler's decision (docs/parity.md)."""
    return _one_by_one(topology, lambda _: {})


def kube_with_affinity(topology: Topology) -> Where:
    """As a user writes it by hand: every pod prefers the zone of its peers."""
    peers: dict[str, list[str]] = {}
    for wire in topology.wires:
        peers.setdefault(wire.start, []).append(wire.end)
        peers.setdefault(wire.end, []).append(wire.start)

    def affinity(part: Part) -> Json:
        near = {
            "topologyKey": str(Label.ZONE),
            "labelSelector": {
                "matchExpressions": [{"key": "component", "operator": "In", "values": sorted(set(peers[part.name]))}]
            },
        }
        wish = [{"weight": 100, "podAffinityTerm": near}]
        return {"affinity": {"podAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": wish}}}

    return _one_by_one(topology, affinity)


SCHEDULERS: Final[Mapping[str, Callable[[Topology], Where]]] = {
    "RobotApp": ours,
    "kube-scheduler": kube,
    "kube-scheduler with zone affinity": kube_with_affinity,
}


def _cluster(topology: Topology) -> SchedulerCore:
    core = make_core(
        *(
            make_node(each.name, cpu=f"{each.cpu_milli}m", memory="64Gi", labels={str(Label.ZONE): each.zone})
            for each in topology.machines
        )
    )
    for each in topology.machines:
        if each.used_milli:
            core.cluster.apply_pod(make_pod(f"load-{each.name}", cpu=f"{each.used_milli}m", node=each.name))
    return core


def _one_by_one(topology: Topology, more: Callable[[Part], Json]) -> Where:
    core = _cluster(topology)
    pods: list[Pod] = [
        make_pod(part.name, labels={"component": part.name}, **_spec(part), **more(part)) for part in topology.parts
    ]
    where: Where = {}
    for pod in pods:  # a Deployment each: they come one after the other
        arrive(core, pod)
        where |= run(core)
    return where


def _spec(part: Part) -> Json:
    bound = {"nodeSelector": {"kubernetes.io/hostname": part.node}} if part.node else {}
    return {"cpu": f"{part.cpu_milli}m", "memory": "16Mi", **bound}
