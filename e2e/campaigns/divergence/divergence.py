"""Edges within budget under our scheduler and kube-scheduler on random topologies: scripts/bench divergence

Each topology has 3 to 40 nodes in up to six zones, every round trip measured, nodes partly taken, and an app of 2 to 12
components whose edges have budgets. It is placed by our scheduler (the joint planner with the scheduler's own problem builder),
by kube-scheduler's rules, and by these with pod affinity to the zone of the peers. HiGHS proves whether any placement
meets all budgets; where one does, ours must, and that is the end with 0. No control plane is started.
"""

import argparse
import json
import platform
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from random import Random
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_array
from tests.support.scheduler.pod_groups import arrive, run
from tests.support.scheduling import app_object, chain, make_core, make_node, make_pod, member_pod, telemetry

from campaigns.common import options
from campaigns.divergence.topology import P95, Part, Topology, draw
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


SECONDS: Final = 60.0
_OPTIMAL, _INFEASIBLE = 0, 2


class Proof(StrEnum):
    """What is proved of a set of budgets."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    OPEN = "open"
    """Neither within the time."""


def proof(topology: Topology, *, seconds: float = SECONDS) -> Proof:
    """One variable per component and node. A feasible answer is checked against the topology itself."""
    nodes = [machine.name for machine in topology.machines]
    count = len(nodes)
    index = {part.name: i for i, part in enumerate(topology.parts)}
    upper = np.ones(len(topology.parts) * count)
    for part in topology.parts:
        if part.node:
            own = slice(index[part.name] * count, (index[part.name] + 1) * count)
            upper[own] = [float(name == part.node) for name in nodes]
    rows: list[tuple[dict[int, float], float, float]] = [
        ({i * count + n: 1.0 for n in range(count)}, 1.0, 1.0) for i in range(len(topology.parts))
    ]
    for n, machine in enumerate(topology.machines):
        load = {index[part.name] * count + n: float(part.cpu_milli) for part in topology.parts}
        rows.append((load, -np.inf, float(machine.free_milli)))
    for wire in topology.wires:
        start, end = index[wire.start] * count, index[wire.end] * count
        for n, name in enumerate(nodes):
            far = [m for m, other in enumerate(nodes) if topology.p95_us(name, other) > wire.budget_us]
            if far:  # with this end here, the other one is on none of these
                rows.append(({start + n: 1.0, **{end + m: 1.0 for m in far}}, -np.inf, 1.0))
    matrix = lil_array((len(rows), len(upper)))
    for r, (entries, _, _) in enumerate(rows):
        for column, value in entries.items():
            matrix[r, column] = value
    found = milp(
        np.zeros(len(upper)),
        integrality=np.ones(len(upper)),
        bounds=Bounds(0.0, upper),
        constraints=LinearConstraint(matrix.tocsr(), [low for _, low, _ in rows], [high for _, _, high in rows]),
        options={"time_limit": seconds},
    )
    if found.status == _INFEASIBLE:
        return Proof.INFEASIBLE
    if found.status != _OPTIMAL:
        return Proof.OPEN
    where = {
        part.name: nodes[int(found.x[i * count : (i + 1) * count].argmax())]
        for part, i in zip(topology.parts, index.values(), strict=True)
    }
    assert topology.fits(where), "HiGHS overloads a node"
    assert topology.met(where) == len(topology.wires), "HiGHS breaks a budget"
    return Proof.FEASIBLE


class Placed(NamedTuple):
    """One scheduler's result: edges within budget, edges that run over it, pods without a node."""

    met: int
    broken: int
    pending: int


class Outcome(NamedTuple):
    """One topology. `placed` by scheduler."""

    number: int
    nodes: int
    components: int
    edges: int
    proof: Proof
    placed: dict[str, Placed]
    overloaded: bool
    """Our scheduler put more on a node than it has."""

    def all_met(self, scheduler: str) -> bool:
        """Is every edge within its budget?"""
        return self.placed[scheduler].met == self.edges

    @property
    def missed(self) -> str:
        """What must not be; "" for an outcome as it should be."""
        ours = next(iter(SCHEDULERS))
        if self.overloaded:
            return "our plan overloads a node"
        if self.proof is Proof.FEASIBLE and not self.all_met(ours):
            return "HiGHS meets all budgets, ours does not"
        if self.proof is Proof.INFEASIBLE and self.all_met(ours):
            return "ours meets budgets that HiGHS proves impossible"
        if self.proof is Proof.OPEN:
            return "HiGHS proved neither in time"
        return "ours runs an edge over its budget" if self.placed[ours].broken else ""


def outcomes(seed: int, numbers: Sequence[int]) -> Iterator[Outcome]:
    """Topology by topology; the same seed and number give the same one."""
    for number in numbers:
        topology = draw(Random(f"{seed}/{number}"))
        placed, overloaded = dict[str, Placed](), False
        for i, (name, place) in enumerate(SCHEDULERS.items()):
            where = place(topology)
            placed[name] = Placed(topology.met(where), topology.broken(where), len(topology.parts) - len(where))
            overloaded |= i == 0 and not topology.fits(where)
        yield Outcome(
            number,
            len(topology.machines),
            len(topology.parts),
            len(topology.wires),
            proof(topology),
            placed,
            overloaded,
        )


class Row(NamedTuple):
    """One scheduler over all topologies, in per cent."""

    scheduler: str
    edges_met_where_feasible: float
    all_met_where_feasible: float
    edges_met: float
    edges_over_budget: float
    """Edges that run although they are over their budget: both ends are placed."""


def rows(found: Sequence[Outcome]) -> list[Row]:
    """The table."""
    feasible = [each for each in found if each.proof is Proof.FEASIBLE]

    def share(part: int, whole: int) -> float:
        return round(100 * part / whole, 1) if whole else 0.0

    return [
        Row(
            name,
            share(sum(each.placed[name].met for each in feasible), sum(each.edges for each in feasible)),
            share(sum(each.all_met(name) for each in feasible), len(feasible)),
            share(sum(each.placed[name].met for each in found), sum(each.edges for each in found)),
            share(sum(each.placed[name].broken for each in found), sum(each.edges for each in found)),
        )
        for name in SCHEDULERS
    ]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench divergence", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--topologies", type=options.count(1), default=200)
    parser.add_argument("--first", type=options.count(0), default=0, metavar="N", help="number of the first topology")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="write every outcome to this file")
    arguments = parser.parse_args(argv)
    found: list[Outcome] = []
    for outcome in outcomes(arguments.seed, range(arguments.first, arguments.first + arguments.topologies)):
        found.append(outcome)
        if outcome.missed:
            print(f"topology {outcome.number}: {outcome.missed}: {outcome}", file=sys.stderr, flush=True)
    proofs = dict(Counter(str(each.proof) for each in found))
    Console(width=120).print(table(found))
    print(f"HiGHS: {proofs}; planner's limit: {1000 * IN_WORKER.seconds:.0f} ms of CPU")
    if arguments.json:
        given = {"topologies": arguments.topologies, "first": arguments.first, "seed": arguments.seed}
        report = {
            **given,
            "python": platform.python_version(),
            "proofs": proofs,
            "rows": [row._asdict() for row in rows(found)],
            "outcomes": [
                {**each._asdict(), "placed": {name: placed._asdict() for name, placed in each.placed.items()}}
                for each in found
            ],
        }
        arguments.json.write_text(json.dumps(report, indent=1))
    return 1 if any(each.missed for each in found) else 0


def table(found: Sequence[Outcome]) -> Table:
    """One line per scheduler."""
    result = Table(title=f"{len(found)} topologies, {sum(each.edges for each in found)} edges")
    result.add_column("scheduler")
    for title in (
        "edges in budget, where HiGHS meets all",
        "apps with all budgets met, of these",
        "edges in budget, all topologies",
        "edges that run over budget",
    ):
        result.add_column(title, justify="right")
    for row in rows(found):
        result.add_row(row.scheduler, *(f"{value:.1f} %" for value in row[1:]))
    return result


if __name__ == "__main__":
    sys.exit(main())
