"""One app on a thousand robots: are all its instances visible, how often is each written, and what does that cost?

Nodes, kubelets and telemetry are simulated; operator, scheduler and API server are real. Every robot has an instance of two
components, one on board and one on an edge server, with a latency budget between them.
"""

import argparse
import json
import random
import statistics
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from tests.bench import options
from tests.support import process_use, quiet
from tests.support.appwatch import condition
from tests.support.world import APIS, Object, World, plain_app

from robotapp_api.model.names import API_VERSION, Condition, Label
from robotapp_testbed import ControlPlane, product, wait_until
from robotapp_testbed.network import Topology
from robotapp_testbed.topology import fleet

PODS_PER_EDGE = 100
POOL = "shared"
MOST_WRITES_TO_READY = 4
MOST_STATUS_PER_S = 1.0
MOST_STATUS_BYTES = 64 * 1024
ROUND_S = 10.0
NODE_LEASE_S = 600
"""The simulated kubelets must not be late beside a busy API server: pods of a node that was NotReady stay so under kwok."""
NOISE = 0.2
INSTANCES = "robotappinstances"

Figures = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    with ControlPlane(audit=True, node_lease_s=NODE_LEASE_S) as cp:
        product.install(cp)
        spec = {"scope": "Cluster", "ids": "1-50", "sharedIds": "60-101", "quarantineSeconds": 1}
        pool = {"apiVersion": API_VERSION, "kind": "DomainPool", "metadata": {"name": POOL}, "spec": spec}
        cp.api.create(f"{APIS}/domainpools", pool)
        with World(cp, _nodes(arguments.robots), tidy=False) as world:
            figures, problems = run(world, arguments)
    print(json.dumps(figures, indent=2))
    for problem in problems:
        print(f"MISSED: {problem}", file=sys.stderr)
    if arguments.json:
        arguments.json.write_text(json.dumps({**figures, "problems": problems}, indent=2) + "\n")
    return 1 if problems else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench fleet", description=__doc__)
    parser.add_argument("--robots", type=options.count(1, 5000), default=1000)
    parser.add_argument("--quiet-seconds", type=options.amount, default=60.0, help="how long nothing changes")
    parser.add_argument(
        "--noise-seconds", type=options.amount, default=120.0, help="how long round trips wobble by a fifth"
    )
    parser.add_argument(
        "--within", type=options.amount, default=900.0, help="seconds until all instances must be Ready"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    return parser


def run(world: World, arguments: argparse.Namespace) -> tuple[Figures, list[str]]:
    """Start, rest and noise, one after the other."""
    began = datetime.now(UTC)
    start, problems = _start(world, arguments.robots, within_s=arguments.within)
    start |= _writes_to_ready(world, began, seconds=start["ready_s"])
    if start["writes_per_instance_median"] > MOST_WRITES_TO_READY:
        problems.append(f"{start['writes_per_instance_median']} writes per instance until it was Ready")
    if start["status_writes_per_s"] > MOST_STATUS_PER_S:
        problems.append(f"{start['status_writes_per_s']:.2f} statuses of the app per second")
    _say(f"{start}")
    quiet.until_quiet(world.cp, quiet_s=quiet.REST_S, within_s=120, namespace=world.namespace)
    rest = quiet.by_object(quiet.writes_during(world.cp, arguments.quiet_seconds, namespace=world.namespace))
    _say(f"at rest: {sum(rest.values())} writes {rest.most_common(3)}")
    problems += [f"{count} writes at rest: {name}" for name, count in rest.most_common(3)]
    noise = _noise(world, arguments)
    _say(f"noise: {noise}")
    if noise["writes_within_a_minute_max"] > 1:
        problems.append(f"{noise['writes_within_a_minute_max']} writes of one instance within a minute under noise")
    return {
        "robots": arguments.robots,
        "start": start,
        "rest": {"seconds": arguments.quiet_seconds, "writes": sum(rest.values())},
        "noise": noise,
        "operator": process_use.usage(world.operator),
        "scheduler": process_use.usage(world.scheduler),
    }, problems


def _start(world: World, robots: int, *, within_s: float) -> tuple[Figures, list[str]]:
    """Apply the app and wait until it and all its instances are Ready."""
    sent_s = world.create(_app())
    world.watch.until_ready("fleet", within_s=within_s)
    ready_s = time.monotonic() - sent_s
    whole = wait_until(lambda: len(_ready(_instances(world))) == robots, timeout_s=60, poll_s=0.5)
    found = _instances(world)
    app = world.app("fleet")
    size = max((len(json.dumps(each["status"])) for each in (*found, app)), default=0)
    figures = {"ready_s": ready_s, "instances": len(found), "ready": len(_ready(found)), "largest_status_bytes": size}
    figures |= {"counts": app["status"]["instanceCounts"]}
    problems = [] if whole else [f"{len(_ready(found))} of {robots} instances are visible and Ready"]
    if size > MOST_STATUS_BYTES:
        problems.append(f"a status of {size} bytes")
    return figures, problems


def _writes_to_ready(world: World, began: datetime, *, seconds: float) -> Figures:
    """By the audit log: writes per instance object, statuses of the app, and everything."""
    records = quiet.writes_since(world.cp, began, namespace=world.namespace)
    per_instance = [len(times) for times in _times(records).values()]
    statuses = [each for each in records if each["objectRef"]["resource"] == "robotapps"]
    return {
        "writes": len(records),
        "writes_per_instance_median": statistics.median(per_instance or [0]),
        "writes_per_instance_max": max(per_instance, default=0),
        "status_writes": len(statuses),
        "status_writes_per_s": len(statuses) / seconds,
    }


def _noise(world: World, arguments: argparse.Namespace) -> Figures:
    """Round trips between every robot and the edge servers wobble, without a budget changing its verdict."""
    wobble = random.Random(arguments.seed)
    robots = [node.name for node in world.nodes if node.robot]
    edges = [node.name for node in world.nodes if not node.robot]
    calm = {(one, other): world.nodes.rtt_ms(one, other) for one in robots for other in edges}
    began = datetime.now(UTC)
    began_s = time.monotonic()
    ends_s = began_s + arguments.noise_seconds
    while (round_began_s := time.monotonic()) < ends_s:
        for (one, other), rtt_ms in calm.items():
            world.nodes.set_rtt(one, other, rtt_ms * wobble.uniform(1 - NOISE, 1 + NOISE))
        world.telemetry.write()
        time.sleep(max(0.0, ROUND_S - (time.monotonic() - round_began_s)))
    records = quiet.writes_since(world.cp, began, namespace=world.namespace)
    seconds = time.monotonic() - began_s  # the last round may take long
    times = _times(records)
    return {
        "seconds": seconds,
        "writes": len(records),
        "writes_within_a_minute_max": max(map(quiet.most_within_a_minute, times.values()), default=0),
        "writes_per_instance_minute_mean": sum(map(len, times.values())) / len(robots) / (seconds / 60),
        "status_writes": sum(each["objectRef"]["resource"] == "robotapps" for each in records),
    }


def _times(records: Iterable[Mapping[str, Any]]) -> Mapping[str, list[datetime]]:
    """When each instance was written, in order."""
    times: dict[str, list[datetime]] = {}
    for each in records:
        if each["objectRef"]["resource"] == INSTANCES:
            received = datetime.fromisoformat(each["requestReceivedTimestamp"])
            times.setdefault(each["objectRef"].get("name", ""), []).append(received)
    return {name: sorted(mine) for name, mine in times.items()}


def _app() -> Object:
    everybody = {"matchExpressions": [{"key": Label.ROBOT, "operator": "Exists"}]}
    app = plain_app(
        "fleet",
        parts=("drive", "watch"),
        robots={"nodeSelector": everybody},
        ros2={"pool": POOL, "isolation": "Discovery", "rmw": "rmw_cyclonedds_cpp"},
        edges=[{"topic": "/odom", "from": "drive", "to": "watch", "latency": {"budget": "100ms"}}],
    )
    for part, tier in zip(app["spec"]["components"], ("Robot", "Edge"), strict=True):
        part["runsOn"] = [tier]
    return app


def _nodes(robots: int) -> Topology:
    return fleet(robots=[f"amr-{number:04}" for number in range(robots)], edges=robots // PODS_PER_EDGE + 1, clouds=0)


def _instances(world: World) -> list[Object]:
    found: list[Object] = world.cp.api.get(f"{APIS}/namespaces/{world.namespace}/{INSTANCES}")["items"]
    return found


def _ready(instances: Sequence[Object]) -> list[Object]:
    return [each for each in instances if condition(each, Condition.READY).get("status") == "True"]


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
