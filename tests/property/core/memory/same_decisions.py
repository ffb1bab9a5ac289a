"""A program that takes decisions and prints them: processes with different PYTHONHASHSEEDs must print the same.

Nodes and pods are alike on purpose. Wherever the order of a set could decide between them, it would, and each decision
changes those that follow.
"""

import json
import sys
from collections.abc import Iterator, Mapping
from itertools import pairwise
from random import Random
from typing import Any, Final

from tests.property.core.ros.latency_networks import Network, network
from tests.support.scheduler.pod_groups import arrive, depart
from tests.support.scheduling import Clock, app_object, chain, make_core, make_node, make_pod, member_pod, telemetry

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cycle.group_cycle import placement_of
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.core.cycle.schedule_result import ScheduleResult
from robotapp_scheduler.core.explain.record import as_json
from robotapp_scheduler.core.queue.queued_pod_info import Rejection
from robotapp_scheduler.joint.solve import Limits, solve

Json = dict[str, Any]
NODES: Final = 18
COMPONENTS: Final = ("driver", "camera", "planner", "map")
UNHURRIED: Final = Limits(seconds=1.0, steps=200)
"""The clock stands still, so that steps alone decide when a search ends."""
DEVICES: Final = [{"id": f"can-can{i}", "type": "can", "interface": f"can{i}"} for i in range(2)]
ROS: Final[tuple[Mapping[Annotation, Json], ...]] = (
    {Annotation.POLICIES: {"latency_budget": "90ms", "deadline": "120ms"}, Annotation.TOPOLOGY: {"master_node": "n1"}},
    {Annotation.POLICIES: {"qos_class": "realtime"}, Annotation.TOPOLOGY: {"preferred_zones": ["zone-1", "zone-0"]}},
    {Annotation.POLICIES: {"latency_budget": "90ms"}, Annotation.SHARED_DATA: {"peer_pods": ["low-3", "low-1"]}},
    {Annotation.AFFINITY: {"hardware_requirements": [{"type": "can"}]}},
)


def main() -> None:
    """Fill a cluster in waves; the last ones find it full, take the places of others, and wait for those that go."""
    net, clock = network(Random("the same in every process"), nodes=NODES, zones=3, robots=0.5), Clock()
    core = field(net, clock)
    for percentile in (50, 95):
        show("round trips", core.cluster.rtt.from_node("n0", percentile).rtt_us.tolist())
    low = [make_pod(f"low-{i}", cpu="900m", labels={"app": f"low-{i % 3}"}) for i in range(2 * NODES)]
    for wave in (low, bare(), spread(), teleop(core), high()):
        arrive(core, *wave)
        report(core)
    depart(core, *low[::3])
    clock.forward(60.0)
    core.cluster.tick()
    report(core)


def field(net: Network, clock: Clock) -> SchedulerCore:
    """Nodes of one size, each with two equal devices, and readings of their agents."""
    nodes = [make_node(name, cpu="4", labels={str(Label.ZONE): zone}) for name, zone in net.zone.items()]
    core = make_core(*nodes, clock=clock)
    for name, peers in net.readings.items():
        core.cluster.apply_telemetry(telemetry(name, rtt_ms=peers, devices=DEVICES, interval_s=3600))
    return core


def bare() -> list[Pod]:
    """Pods with ROS annotations."""
    texts = [{str(key): json.dumps(value) for key, value in each.items()} for each in ROS]
    return [make_pod(f"bare-{i}", cpu="200m", annotations=texts[i % len(texts)]) for i in range(16)]


def spread() -> list[Pod]:
    """Pods that keep to some of the others and away from their like."""
    away = {"topologyKey": str(Label.ZONE), "labelSelector": {"matchLabels": {"app": "wide"}}}
    near = {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": {"app": "low-1"}}}
    affinity = {
        "podAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 5, "podAffinityTerm": near}]},
        "podAntiAffinity": {
            "preferredDuringSchedulingIgnoredDuringExecution": [{"weight": 5, "podAffinityTerm": away}]
        },
    }
    return [make_pod(f"wide-{i}", cpu="100m", labels={"app": "wide"}, affinity=affinity) for i in range(12)]


def teleop(core: SchedulerCore) -> list[Pod]:
    """The pods of an app whose components talk to each other."""
    edges = [{"topic": f"/{a}", "from": a, "to": b, "latency": {"budget": "90ms"}} for a, b in pairwise(COMPONENTS)]
    components = [{"name": name} for name in COMPONENTS[:-1]]
    core.cluster.apply_app(app_object(*components, {"name": "map", "colocateWith": ["planner", "camera"]}, edges=edges))
    for name in COMPONENTS:
        for owned in chain(name):
            core.cluster.apply_owner(owned)
    return [member_pod(name, cpu="300m") for name in COMPONENTS]


def high() -> list[Pod]:
    """Pods for which others have to go."""
    return [make_pod(f"high-{i}", cpu="3", priority=100) for i in range(8)]


def report(core: SchedulerCore) -> None:
    """Place what waits, and print each decision with what `explain` knows of it."""
    for decision in decided(core):
        record = core.explain.get(decision.pod.uid)
        victims = [victim.uid for victim in decision.plan.victims] if decision.plan is not None else []
        explained = json.dumps(as_json(record)) if record is not None else ""
        show(decision.pod.name, decision.code, decision.node, decision.message, victims, decision.grants, explained)


def show(*parts: object) -> None:
    sys.stdout.write(" ".join(map(str, parts)) + "\n")


def decided(core: SchedulerCore) -> Iterator[ScheduleResult]:
    while batch := core.queue.pop():
        joint = core.joint_problem_of(batch)
        placement = placement_of(joint, solve(joint.problem, UNHURRIED, lambda: 0.0)) if joint is not None else None
        for decision in core.schedule(batch, placement=placement):
            if decision.placed:
                core.queue.done(decision.pod.uid)
            elif decision.queued is not None:
                core.queue.requeue(decision.queued, Rejection(decision.rejected_by))
            yield decision


if __name__ == "__main__":
    main()
