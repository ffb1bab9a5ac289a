"""One app on a thousand robots: are all its instances visible, how often is each written, and what does that cost?

Nodes, kubelets and telemetry are simulated; operator, scheduler and API server are real. Every robot has an instance of
some components, the first on board and the others on edge servers, with a latency budget between each of them and the first.
Claims are swept as often as by default.
"""

import argparse
import json
import statistics
import sys
import time
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

from campaigns.common import options, process_use
from campaigns.common.figures import percentile
from campaigns.common.output import save, say
from campaigns.rigs import quiet
from campaigns.rigs.appwatch import condition
from campaigns.rigs.simulated_site import APIS, Object, SimulatedSite, plain_app
from robotapp_api.model.names import API_VERSION, Condition, Label
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.servers import Program
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import edge, robot


class Wobbling(Topology):
    """Another factor for every pair after each `wobble`, the same in both directions; nothing is kept per pair."""

    _share = 0.0
    _seed = 0

    def wobble(self, share: float, *, seed: int) -> None:
        """From now on each time lies within `share` of its calm value."""
        self._share, self._seed = share, seed

    def rtt_ms(self, one: str, other: str) -> float:
        calm_ms = super().rtt_ms(one, other)
        if not self._share:
            return calm_ms
        first, second = sorted((one, other))
        chance = zlib.crc32(f"{self._seed} {first} {second}".encode()) / 2**32
        return calm_ms * (1 + self._share * (2 * chance - 1))


PODS_PER_EDGE: Final = 100
HALLS: Final = 20
POOL: Final = "shared"
MOST_WRITES_TO_READY: Final = 4
MOST_STATUS_PER_S: Final = 1.0
MOST_STATUS_BYTES: Final = 64 * 1024
MOST_RSS_BYTES: Final = 500_000_000
ROUND_S: Final = 10.0
SWEEP_S: Final = 30
MEASURED_S: Final = 600.0
"""Until each budget is measured. An agent learns with its next heartbeat what it is asked to measure; with 5000 simulated ones that is every 100 s."""
CALM_S: Final = 240.0
"""Until the last latency figures are published, and then a while in which nothing is written."""
NODE_LEASE_S: Final = 600
"""The simulated kubelets must not be late beside a busy API server: each node that is out of contact costs writes."""
INSTANCES: Final = "robotappinstances"
Figures = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    with ControlPlane(audit=True, node_lease_s=NODE_LEASE_S) as cp:
        product.install(cp)
        spec = {"scope": "Cluster", "network": "fleet", "ids": "1-50", "sharedIds": "60-101", "quarantineSeconds": 1}
        pool = {"apiVersion": API_VERSION, "kind": "DomainPool", "metadata": {"name": POOL}, "spec": spec}
        cp.api.create(f"{APIS}/domainpools", pool)
        flags = {"sweep_seconds": SWEEP_S}
        with SimulatedSite(
            cp,
            _nodes(arguments.robots, arguments.nodes, arguments.components),
            operator_flags=flags,
            scheduler_flags=flags,
            tidy=False,
        ) as site:
            figures, problems = run(site, arguments)
    print(json.dumps(figures, indent=2))
    for problem in problems:
        print(f"MISSED: {problem}", file=sys.stderr)
    save(arguments.json, {**figures, "problems": problems})
    return 1 if problems else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench fleet", description=__doc__)
    parser.add_argument("--robots", type=options.count(1, 5000), default=1000)
    parser.add_argument(
        "--components", type=options.count(2, 16), default=2, help="of each instance, one of them on board"
    )
    parser.add_argument(
        "--nodes", type=options.count(2, 10_000), help="robots and edge servers; as many servers as needed by default"
    )
    parser.add_argument("--quiet-seconds", type=options.amount, default=60.0, help="how long nothing changes")
    parser.add_argument("--noise", type=options.amount, default=20.0, help="by how many percent round trips wobble")
    parser.add_argument("--noise-seconds", type=options.amount, default=120.0, help="how long they wobble")
    parser.add_argument(
        "--within", type=options.amount, default=900.0, help="seconds until all instances must be Ready"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    return parser


def run(site: SimulatedSite, arguments: argparse.Namespace) -> tuple[Figures, list[str]]:
    """Start, rest and noise, one after the other."""
    began, before = datetime.now(UTC), _cpu_s(site)
    start, problems = _start(site, arguments, began)
    start |= _writes_to_ready(site, began, robots=arguments.robots, seconds=start["ready_s"])
    start["cpu_s"] = _spent(site, before)
    start["operator_ms_per_instance"] = start["cpu_s"]["operator"] * 1000 / arguments.robots
    if start["writes_per_instance_median"] > MOST_WRITES_TO_READY:
        problems.append(f"{start['writes_per_instance_median']} writes per instance until it was Ready")
    if start["status_writes_per_s"] > MOST_STATUS_PER_S:
        problems.append(f"{start['status_writes_per_s']:.2f} statuses of the app per second")
    say(f"{start}")
    began_s = time.monotonic()
    if not wait_until(lambda: not _unmeasured(site), timeout_s=MEASURED_S, poll_s=5.0):
        problems.append(f"budgets of {len(_unmeasured(site))} instances are not measured after {MEASURED_S:.0f} s")
    start["measured_after_ready_s"] = time.monotonic() - began_s
    if not quiet.until_quiet(site.cp, quiet_s=quiet.REST_S, within_s=CALM_S, namespace=site.namespace):
        problems.append(f"it did not come to rest within {CALM_S:.0f} s")
    before = _cpu_s(site)
    records = quiet.writes_during(site.cp, arguments.quiet_seconds, namespace=site.namespace)
    counts = quiet.by_object(records)
    rest = {"seconds": arguments.quiet_seconds, "writes": len(records), "cpu_s": _spent(site, before)}
    say(f"at rest: {rest} {counts.most_common(3)}")
    problems += [f"{count} writes at rest: {name}" for name, count in counts.most_common(3)]
    noise = _noise(site, arguments)
    say(f"noise: {noise}")
    if noise["writes_within_a_minute_max"] > 1:
        problems.append(f"{noise['writes_within_a_minute_max']} writes of one instance within a minute under noise")
    figures = {
        "robots": arguments.robots,
        "components": arguments.components,
        "nodes": len(site.nodes),
        "start": start,
        "rest": rest,
        "noise": noise,
    }
    for process in (site.operator, site.scheduler):
        figures[process.name] = used = process_use.usage(process)
        if used["peak_rss_bytes"] >= MOST_RSS_BYTES:
            problems.append(f"{process.name}: {used['peak_rss_bytes'] / 1e6:.0f} MB")
    return figures, problems


def _start(site: SimulatedSite, arguments: argparse.Namespace, began: datetime) -> tuple[Figures, list[str]]:
    """Apply the app and wait until it and all its instances are Ready."""
    robots, components = arguments.robots, arguments.components
    sent_s = site.create(_app(components))
    site.watch.until_ready("fleet", within_s=arguments.within)
    ready_s = time.monotonic() - sent_s
    whole = wait_until(lambda: len(_ready(_instances(site))) == robots, timeout_s=60, poll_s=0.5)
    found, pods = _instances(site), site.pods()
    app = site.app("fleet")
    size = max((len(json.dumps(each["status"])) for each in (*found, app)), default=0)
    placed = sum(bool(pod["spec"].get("nodeName")) for pod in pods)
    took_s = [_ready_after_s(each, began) for each in _ready(found)] or [0.0]
    figures = {
        "ready_s": ready_s,
        "instance_ready_p50_s": percentile(took_s, 50),
        "instance_ready_p95_s": percentile(took_s, 95),
        "instances": len(found),
        "ready": len(_ready(found)),
        "pods": len(pods),
        "placed": placed,
        "largest_status_bytes": size,
        "counts": app["status"]["instanceCounts"],
    }
    problems = [] if whole else [f"{len(_ready(found))} of {robots} instances are visible and Ready"]
    if placed != robots * components:
        problems.append(f"{placed} of {robots * components} pods are placed")
    if size > MOST_STATUS_BYTES:
        problems.append(f"a status of {size} bytes")
    return figures, problems


def _ready_after_s(instance: Object, began: datetime) -> float:
    """By the condition's own time, which has whole seconds."""
    return (datetime.fromisoformat(condition(instance, Condition.READY)["lastTransitionTime"]) - began).total_seconds()


def _writes_to_ready(site: SimulatedSite, began: datetime, *, robots: int, seconds: float) -> Figures:
    """By the audit log: writes per instance and of which kinds, writes per instance object, statuses of the app."""
    records = quiet.writes_since(site.cp, began, namespace=site.namespace)
    per_instance = [len(times) for times in _times(records).values()]
    statuses = [each for each in records if each["objectRef"]["resource"] == "robotapps"]
    kinds = Counter(" ".join(name.split()[:3]) for name in quiet.by_object(records).elements())
    return {
        "writes": len(records),
        "writes_per_instance": len(records) / robots,
        "writes_by_kind": dict(kinds.most_common()),
        "writes_per_instance_median": statistics.median(per_instance or [0]),
        "writes_per_instance_max": max(per_instance, default=0),
        "status_writes": len(statuses),
        "status_writes_per_s": len(statuses) / seconds,
    }


def _noise(site: SimulatedSite, arguments: argparse.Namespace) -> Figures:
    """Round trips between the nodes in use wobble, without a budget changing its verdict."""
    nodes = site.nodes
    assert isinstance(nodes, Wobbling)
    used = {pod["spec"]["nodeName"] for pod in site.pods() if pod["spec"].get("nodeName")}
    names = sorted(used | {node.name for node in nodes if node.robot})
    began, before = datetime.now(UTC), _cpu_s(site)
    began_s = time.monotonic()
    reports = 0
    while (round_began_s := time.monotonic()) < began_s + arguments.noise_seconds:
        nodes.wobble(arguments.noise / 100, seed=arguments.seed + reports)
        site.telemetry.write(*names)
        reports += len(names)
        time.sleep(max(0.0, ROUND_S - (time.monotonic() - round_began_s)))
    records = quiet.writes_since(site.cp, began, namespace=site.namespace)
    seconds = time.monotonic() - began_s  # the last round may take long
    times = _times(records)
    return {
        "percent": arguments.noise,
        "seconds": seconds,
        "reports": reports,
        "writes": len(records),
        "writes_within_a_minute_max": max(map(quiet.most_within_a_minute, times.values()), default=0),
        "writes_per_instance_minute_mean": sum(map(len, times.values())) / arguments.robots / (seconds / 60),
        "status_writes": sum(each["objectRef"]["resource"] == "robotapps" for each in records),
        "cpu_s": _spent(site, before),
    }


def _times(records: Iterable[Mapping[str, Any]]) -> Mapping[str, list[datetime]]:
    """When each instance was written, in order."""
    times: dict[str, list[datetime]] = {}
    for each in records:
        if each["objectRef"]["resource"] == INSTANCES:
            received = datetime.fromisoformat(each["requestReceivedTimestamp"])
            times.setdefault(each["objectRef"].get("name", ""), []).append(received)
    return {name: sorted(mine) for name, mine in times.items()}


def _cpu_s(site: SimulatedSite) -> Mapping[str, float]:
    """CPU seconds so far."""
    processes = (site.operator, site.scheduler, site.cp.process(Program.API))
    return {process.name: process.cpu_seconds() for process in processes}


def _spent(site: SimulatedSite, before: Mapping[str, float]) -> dict[str, float]:
    return {name: round(now_s - before[name], 2) for name, now_s in _cpu_s(site).items()}


def _app(components: int) -> Object:
    everybody = {"matchExpressions": [{"key": Label.ROBOT, "operator": "Exists"}]}
    parts = ("drive", *(f"watch-{number}" for number in range(1, components)))
    app = plain_app(
        "fleet",
        parts=parts,
        robots={"nodeSelector": everybody},
        ros2={"pool": POOL, "isolation": "Discovery", "rmw": "rmw_cyclonedds_cpp"},
        edges=[{"topic": "/odom", "from": "drive", "to": other, "latency": {"budget": "100ms"}} for other in parts[1:]],
    )
    for part in app["spec"]["components"]:
        part["runsOn"] = ["Robot" if part["name"] == "drive" else "Edge"]
    return app


def _nodes(robots: int, nodes: int | None, components: int) -> Wobbling:
    """Robots and edge servers, spread over the halls alike."""
    servers = robots * (components - 1) // PODS_PER_EDGE + 1 if nodes is None else max(1, nodes - robots)
    halls = min(servers, HALLS)
    made = [robot(f"amr-{number:04}", zone=f"hall-{number % halls + 1}") for number in range(robots)]
    made += [edge(f"edge-{number:04}", zone=f"hall-{number % halls + 1}") for number in range(servers)]
    return Wobbling(made)


def _instances(site: SimulatedSite) -> list[Object]:
    found: list[Object] = site.cp.api.get(f"{APIS}/namespaces/{site.namespace}/{INSTANCES}")["items"]
    return found


def _unmeasured(site: SimulatedSite) -> list[Object]:
    """Instances of which it is not known yet whether they keep their budgets: that will be written when it is."""
    return [each for each in _instances(site) if condition(each, Condition.BUDGET_MET).get("status") == "Unknown"]


def _ready(instances: Sequence[Object]) -> list[Object]:
    return [each for each in instances if condition(each, Condition.READY).get("status") == "True"]


if __name__ == "__main__":
    sys.exit(main())
