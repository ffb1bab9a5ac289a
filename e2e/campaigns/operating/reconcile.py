"""Measures what the operator costs: CPU per app, per instance and per report of a node, and which requests it sends.

The operator is a process of its own against an API server in memory, whose Deployments become Ready by themselves; so the
figures are the operator's alone. Figures of two trees are comparable when they were taken in turn: `--tree` is the folder of the other one.
"""

import argparse
import asyncio
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import yaml

from campaigns.common import options, process_use
from campaigns.common.output import save, say
from campaigns.operating.small_cluster import ON_BOARD, SmallCluster
from campaigns.rigs.appwatch import is_ready
from campaigns.rigs.simulated_site import plain_app
from robotapp_api.model.names import Label
from robotapp_client.api.resources import ROBOTAPPINSTANCES, ROBOTAPPS
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.processes.process import Process

IDS: Final = "1-101,215-232"
POOLS: Final[Mapping[str, Mapping[str, Any]]] = {
    "bench-a": {"scope": "Cluster", "ids": IDS, "quarantineSeconds": 1},
    "bench-b": {"scope": "Cluster", "ids": IDS, "quarantineSeconds": 1},
    "shared": {"scope": "Cluster", "ids": "1-50", "sharedIds": "60-101", "quarantineSeconds": 1},
}
STILL_S: Final = 4.0
WITHIN_S: Final = 300.0
SWINGS: Final = (1.15, 0.85)
SWEEP_S: Final = 30

Figures = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    trees = [REPOSITORY, *([arguments.tree.resolve()] if arguments.tree else [])]
    found: dict[str, list[Figures]] = {}
    for number in range(arguments.rounds):
        for tree in trees:
            for row in arguments.only or ROWS:
                figures = asyncio.run(_row(row, arguments, tree))
                found.setdefault(f"{row}, {'other tree' if tree != REPOSITORY else 'this tree'}", []).append(figures)
                say(f"{row} {tree} {number}: {figures['ms_per_instance']:.2f} ms per instance")
    for name, runs in found.items():
        _print(name, runs)
    save(arguments.json, found)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench reconcile", description=__doc__.splitlines()[0])
    parser.add_argument("--apps", type=options.count(1, 200), default=100, help="apps of three components")
    parser.add_argument(
        "--robots", type=options.count(1, 2000), default=100, help="robots of one app of three components"
    )
    parser.add_argument(
        "--reports", type=options.count(0), default=4, help="rounds of reports by all nodes, afterwards"
    )
    parser.add_argument("--rounds", type=options.count(1), default=1, help="repeat everything so often")
    parser.add_argument("--tree", type=Path, help="folder of another working tree, measured in turn with this one")
    parser.add_argument("--only", choices=sorted(ROWS), action="append", help="this row only (may be repeated)")
    parser.add_argument("--json", type=options.report, help="also write every figure to this file")
    return parser


async def _row(row: str, arguments: argparse.Namespace, tree: Path) -> Figures:
    apps, robots = ROWS[row](arguments)
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        async with SmallCluster(robots=robots, pools=POOLS) as cluster:
            process = _operator(folder, cluster.endpoint.server, tree)
            try:
                return await _measure(cluster, process, apps, robots, arguments.reports)
            finally:
                await asyncio.to_thread(process.stop)


async def _measure(
    cluster: SmallCluster, process: Process, apps: Sequence[dict[str, Any]], robots: int, reports: int
) -> Figures:
    process.start()
    await _until(lambda: cluster.watching >= WATCHES, process, "it watches")
    await asyncio.sleep(STILL_S)
    cluster.requests.clear()
    before_s, began_s = process_use.cpu_seconds(process.pid), time.monotonic()
    for app in apps:
        cluster.apply(app)
    instances = max(len(apps), robots)

    def ready() -> bool:
        objects = cluster.store.all(ROBOTAPPINSTANCES)
        return (
            all(is_ready(app) for app in cluster.store.all(ROBOTAPPS))
            and len(objects) == instances
            and all(each.get("status", {}).get("phase") == "Running" for each in objects)
        )

    await _until(ready, process, "all Ready")
    took_s = time.monotonic() - began_s
    await _still(cluster)
    figures: Figures = {
        "instances": instances,
        "ready_s": took_s,
        "cpu_s": process_use.cpu_seconds(process.pid) - before_s,
        "requests": dict(_kinds(cluster.requests)),
        "writes": dict(_kinds((method, path) for method, path in cluster.requests if method != "GET")),
    }
    figures["ms_per_instance"] = figures["cpu_s"] * 1000 / instances
    cluster.requests.clear()
    before_s, sent = process_use.cpu_seconds(process.pid), 0
    for number in range(reports):
        sent += cluster.report(seq=number + 2, factor=SWINGS[number % 2])
        await asyncio.sleep(STILL_S)
    figures["reports"] = sent
    figures["us_per_report"] = (process_use.cpu_seconds(process.pid) - before_s) * 1e6 / max(1, sent)
    figures["writes_after_reports"] = sum(method != "GET" for method, _ in cluster.requests)
    figures["peak_rss_bytes"] = process_use.peak_rss_bytes(process.pid)
    return figures


def _operator(folder: Path, server: str, tree: Path) -> Process:
    """Returns the operator from the packages of `tree`."""
    kubeconfig = folder / "kubeconfig"
    kubeconfig.write_text(
        yaml.safe_dump(
            {
                "apiVersion": "v1",
                "kind": "Config",
                "clusters": [{"name": "memory", "cluster": {"server": server}}],
                "users": [{"name": "memory", "user": {"token": "x"}}],
                "contexts": [{"name": "memory", "context": {"cluster": "memory", "user": "memory"}}],
                "current-context": "memory",
            }
        )
    )
    paths = [tree / name for name in ("crds", "client", "claims", "operator")]
    flags = ("--kubeconfig", kubeconfig, "--no-leader-election", "--health-port", 0, "--sweep-seconds", SWEEP_S)
    argv = ["-m", "robotapp_operator", *flags]
    return Process(
        "operator",
        [sys.executable, *map(str, argv)],
        run_dir=folder,
        log_path=folder / "operator.log",
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))},
    )


WATCHES: Final = 12
"""Those of the operator's informers and kopf's."""


def _storm(arguments: argparse.Namespace) -> tuple[list[dict[str, Any]], int]:
    pools = ("bench-a", "bench-b")
    apps = [plain_app(f"storm-{number:03}", ros2={"pool": pools[number % 2]}) for number in range(arguments.apps)]
    return apps, 0


def _fleet(arguments: argparse.Namespace) -> tuple[list[dict[str, Any]], int]:
    parts = (ON_BOARD, "watch-1", "watch-2")
    app = plain_app(
        "fleet",
        parts=parts,
        robots={"nodeSelector": {"matchExpressions": [{"key": Label.ROBOT.value, "operator": "Exists"}]}},
        ros2={"pool": "shared", "isolation": "Discovery", "rmw": "rmw_cyclonedds_cpp"},
        edges=[
            {"topic": "/odom", "from": ON_BOARD, "to": other, "latency": {"budget": "100ms"}} for other in parts[1:]
        ],
    )
    for part in app["spec"]["components"]:
        part["runsOn"] = ["Robot" if part["name"] == ON_BOARD else "Edge"]
    return [app], arguments.robots


ROWS: Final[Mapping[str, Callable[[argparse.Namespace], tuple[list[dict[str, Any]], int]]]] = {
    "apps": _storm,
    "fleet": _fleet,
}


async def _until(condition: Callable[[], bool], process: Process, what: str) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not condition():
        if time.monotonic() > deadline_s or not process.running:
            raise TimeoutError(f"not within {WITHIN_S:.0f} s: {what}\n{process.log_text()[-3000:]}")
        await asyncio.sleep(0.2)


async def _still(cluster: SmallCluster) -> None:
    """Until the operator has asked for nothing for a while."""
    count = -1
    while count != len(cluster.requests):
        count = len(cluster.requests)
        await asyncio.sleep(STILL_S)


def _kinds(requests: Any) -> Counter[str]:
    """`PATCH robotapps/status`: how often."""
    found: Counter[str] = Counter()
    for method, path in requests:
        parts = path.partition("?")[0].strip("/").split("/")
        rest = parts[2:] if parts[0] == "api" else parts[3:]
        rest = rest[2:] if rest[:1] == ["namespaces"] and len(rest) > 2 else rest
        one = len(rest) > 1
        found[" ".join([method if method != "GET" or one else "LIST", "/".join([rest[0], *rest[2:]])])] += 1
    return found


def _print(name: str, runs: Sequence[Figures]) -> None:
    first = runs[0]
    print(f"\n{name}: {first['instances']} instances, {len(runs)} runs, medians")
    for figure in ("ready_s", "cpu_s", "ms_per_instance", "us_per_report", "writes_after_reports", "peak_rss_bytes"):
        values = [run[figure] for run in runs]
        print(f"  {figure}: {statistics.median(values):.4g} {[float(f'{each:.4g}') for each in values]}")
    print(f"  requests: {first['requests']}")


if __name__ == "__main__":
    sys.exit(main())
