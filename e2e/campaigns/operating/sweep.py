"""Does a sweep end whole? Instances of a matrix run a few at a time while operator and scheduler are killed and a node is lost.

At the end every instance is Completed and no domain is held; at every revision no instance had two live pods, no domain two users. Nodes and
kubelets are simulated, and a pod of theirs ends as soon as it runs; control plane, Job controller, operator and scheduler are real.
"""

import argparse
import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from math import isqrt
from typing import Any, Final

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.operating.out_of_sight import Fleet
from campaigns.rigs.live import Tenant, eventually, part, pool
from campaigns.storm.history import Event, Judge
from campaigns.storm.recorder import Recorder
from robotapp_api.model.names import Label, Phase
from robotapp_testbed import ControlPlane, Process
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines import topology

Json = dict[str, Any]
APP: Final = "sweep"
NODES: Final = 6
ENDED: Final = frozenset({"Succeeded", "Failed"})
KILL_S: Final = 6.0
"""At most so long between two kills."""
AWAY_S: Final = 3.0
PER_INSTANCE_S: Final = 6.0
"""Patience for each instance, on a machine that has other things to do."""


@dataclass(slots=True)
class Report:
    """What `--json` has."""

    instances: int
    parallelism: int
    seconds: float = 0.0
    phases: dict[str, int] = field(default_factory=dict)
    pods: int = 0
    most_at_once: int = 0
    """Instances with a live pod at one revision."""
    kills: dict[str, int] = field(default_factory=dict)
    lost_nodes: int = 0
    claims_left: int = 0
    grants: int = 0
    problems: list[str] = field(default_factory=list)


class Killer(threading.Thread):
    """Kills operator and scheduler in turn at random moments and starts each anew at once, then takes a node away for a while."""

    def __init__(self, processes: dict[str, Process], fleet: Fleet, *, kills: int, chance: random.Random) -> None:
        super().__init__(daemon=True, name="killer")
        self._fleet = fleet
        self._chance = chance
        self._planned = [*processes] * kills
        self._processes = processes
        self._over = threading.Event()
        self.kills: Counter[str] = Counter()
        self.lost_nodes = 0

    def run(self) -> None:
        for number, name in enumerate(self._planned):
            if self._over.wait(self._chance.uniform(0.5, KILL_S)):
                return
            self._processes[name].kill()
            self._processes[name].start()
            self.kills[name] += 1
            if number == len(self._planned) // 2:
                self._lose_node()

    def _lose_node(self) -> None:
        """Deletes the node that has most pods, so that these are lost, and brings it back."""
        used = Counter(pod["spec"].get("nodeName", "") for pod in self._fleet.tenant.listed("pods"))
        name = max(self._fleet.nodes, key=lambda node: used[node])
        self._fleet.rejoin([name], after_s=AWAY_S)
        self.lost_nodes += 1

    def end(self) -> None:
        self._over.set()
        self.join()


def matrix(instances: int, parallelism: int) -> Json:
    """A matrix of two parameters with so many combinations."""
    seeds = max(count for count in range(1, isqrt(instances) + 1) if instances % count == 0)
    counts = {"speed": instances // seeds, "seed": seeds}
    parameters = [{"name": name, "values": [f"{value}" for value in range(count)]} for name, count in counts.items()]
    return {"parameters": parameters, "parallelism": parallelism}


def count_live_pods(events: Iterable[Event], report: Report, *, app: str = APP) -> None:
    """Counts pods, instances at once, and revisions at which an instance had two pods that were bound and had not ended."""
    live: dict[str, dict[str, str]] = {}
    seen: set[str] = set()
    for event in sorted(event for event in events if event.kind == "Pod"):
        labels = event.obj["metadata"].get("labels", {})
        if labels.get(Label.APP.value) != app:
            continue
        instance = labels.get(Label.INSTANCE.value, "")
        pods = live.setdefault(instance, {})
        if event.gone or not event.obj["spec"].get("nodeName") or event.obj["status"].get("phase") in ENDED:
            pods.pop(event.uid, None)
            continue
        seen.add(event.uid)
        pods[event.uid] = event.obj["metadata"]["name"]
        if len(pods) > 1:
            report.problems.append(
                f"revision {event.revision}: {instance} has {len(pods)} live pods: {sorted(pods.values())}"
            )
        report.most_at_once = max(report.most_at_once, sum(map(bool, live.values())))
    report.pods = len(seen)


def count_phases(tenant: Tenant) -> dict[str, int]:
    """Returns how many instances are in each phase."""
    phases = (str((item.get("status") or {}).get("phase", "")) for item in tenant.instances(APP))
    return dict(Counter(phases))


def run(
    cp: ControlPlane,
    namespace: str,
    processes: dict[str, Process],
    *,
    instances: int,
    parallelism: int,
    kills: int,
    seed: int,
) -> Report:
    """Runs the sweep. Operator and scheduler run already; the nodes are made here."""
    tenant, began_s = Tenant(cp, namespace), time.monotonic()
    written = matrix(instances, parallelism)
    total = len(written["parameters"][0]["values"]) * len(written["parameters"][1]["values"])
    report = Report(total, parallelism)
    nodes = topology.Topology([topology.edge(f"sweep-{number}") for number in range(NODES)])
    fleet = Fleet(cp, nodes, tenant, seed=seed)
    topology.apply(cp, nodes)
    try:
        with pool(cp, APP) as pool_name, Recorder(cp) as recorder:
            eventually(lambda: recorder.passed.get("Pod", 0))
            tenant.apply(APP, part("sim", job={}), matrix=written, ros2={"pool": pool_name})
            killer = Killer(processes, fleet, kills=kills, chance=random.Random(seed))
            killer.start()
            try:
                eventually(
                    lambda: count_phases(tenant).get(Phase.COMPLETED, 0) == total,
                    timeout_s=60 + PER_INSTANCE_S * total,
                    poll_s=2.0,
                    what=lambda: count_phases(tenant),
                )
            finally:
                killer.end()
                report.phases = count_phases(tenant)
            report.seconds = time.monotonic() - began_s
            eventually(lambda: not tenant.claims(), what=lambda: f"{len(tenant.claims())} claims are left")
            report.claims_left = len(tenant.claims())
            report.kills, report.lost_nodes = dict(killer.kills), killer.lost_nodes
            events = recorder.ripe(all_of_them=True)
            report.problems += recorder.problems
            tenant.delete(APP)
            eventually(lambda: not tenant.listed("pods"), what="pods are left")
    finally:
        topology.remove(cp, nodes)
    judge = Judge(namespaces=[namespace])
    judge.hear(events)
    report.grants = judge.verdict.grants
    report.problems += judge.verdict.broken
    count_live_pods(events, report)
    if report.most_at_once > parallelism:
        report.problems.append(f"{report.most_at_once} instances ran at once, the parallelism is {parallelism}")
    return report


def main(argv: Sequence[str] | None = None) -> int:
    """Returns 1 when something did not hold."""
    parser = argparse.ArgumentParser(prog="scripts/bench sweep", description=__doc__)
    parser.add_argument("--instances", type=options.count(1, 256), default=200)
    parser.add_argument("--parallelism", type=options.count(1, 100), default=20)
    parser.add_argument("--kills", type=options.count(0, 100), default=3, help="kills each of operator and scheduler")
    parser.add_argument("--seed", type=options.count(0), default=1)
    parser.add_argument("--json", type=options.report, help="file for the figures")
    read = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp)
        processes = {
            "operator": product.start_operator(cp, sweep_seconds=1, no_leader_election=True),
            "scheduler": product.start_scheduler(cp, sweep_seconds=1),
        }
        with created(cp, "sweep") as namespace:
            say(f"a sweep of {read.instances} instances, {read.parallelism} at once")
            report = run(
                cp,
                namespace,
                processes,
                instances=read.instances,
                parallelism=read.parallelism,
                kills=read.kills,
                seed=read.seed,
            )
    save(read.json, asdict(report))
    print(
        f"{report.instances} instances in {report.seconds:.0f} s: {report.phases}, {report.pods} pods, at most {report.most_at_once} instances at once "
        f"(parallelism {report.parallelism}); kills {report.kills}, {report.lost_nodes} node lost; {report.grants} domains granted, "
        f"{report.claims_left} left"
    )
    for problem in report.problems[:20]:
        print(f"NOT HELD: {problem}")
    return 1 if report.problems else 0


if __name__ == "__main__":
    sys.exit(main())
