"""Our scheduler and kube-scheduler in turn on the same live control plane: pods/s, CPU per pod, latency, ratios.

Drain: the pods exist and the scheduler is up with warm caches, held back by its lease; the clock runs from the first
bind to the last one seen by a watch, CPU is counted until every pod's Event is written. Latency: pods are created at a fixed rate, far below what either can do, and each
is timed from sending its creation until the watch shows it bound. Every run is a fresh process (A B A B).
"""

import argparse
import asyncio
import json
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.bench import contestants, load
from tests.bench.contestants import CONTESTANTS, KUBE_SCHEDULER, OURS, Contestant
from tests.bench.figures import medians, percentile, ratios, table
from tests.bench.workloads import WORKLOADS, node

from robotapp_api.client.api import ApiClient
from robotapp_api.client.login import load as login
from robotapp_api.client.resources import NAMESPACES, PODS
from robotapp_testbed import ControlPlane
from robotapp_testbed.process import Process
from robotapp_testbed.product import install

NAMESPACE = "bench"


@dataclass(frozen=True, slots=True)
class Options:
    nodes: int
    pods: int
    workload: str
    rounds: int
    latency_pods: int
    latency_rate: float


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    options = Options(
        arguments.nodes,
        arguments.pods,
        arguments.workload,
        arguments.rounds,
        arguments.latency_pods,
        arguments.latency_rate,
    )
    order = [OURS, *([CONTESTANTS[arguments.vs]] if arguments.vs else [])]
    say(f"control plane, {options.nodes} nodes, {options.pods} pods ({options.workload}), {options.rounds} rounds")
    with ControlPlane(kwok=False, controller_manager=False) as cp:
        install(cp)
        result = asyncio.run(Bench(cp, options).run(order))
    print(table(dict(result["median"]) | {"ratio": result["ratio"]}))
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")
        say(f"written to {arguments.json}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench scheduler", description=__doc__.splitlines()[0])
    parser.add_argument("--vs", choices=[KUBE_SCHEDULER.name], help="measure this scheduler in turn with ours")
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--pods", type=int, default=3000)
    parser.add_argument("--workload", choices=sorted(WORKLOADS), default="basic")
    parser.add_argument("--rounds", type=int, default=2, help="runs per scheduler; medians are reported")
    parser.add_argument("--latency-pods", type=int, default=500, help="0 leaves the latency phase out")
    parser.add_argument("--latency-rate", type=float, default=50.0, help="pods created per second")
    parser.add_argument("--json", type=Path, help="write every figure to this file")
    return parser


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


class Bench:
    """One control plane, many runs."""

    def __init__(self, cp: ControlPlane, options: Options) -> None:
        self._cp = cp
        self._options = options
        self._make = WORKLOADS[options.workload]

    async def run(self, order: Sequence[Contestant]) -> dict[str, Any]:
        endpoint = await asyncio.to_thread(login, self._cp.kubeconfig("admin"))
        async with ApiClient(endpoint, user_agent="robotapp-bench", max_connections=load.CONNECTIONS) as client:
            say("creating nodes")
            await load.create_nodes(client, [node(index) for index in range(self._options.nodes)])
            await client.create(NAMESPACES, {"metadata": {"name": NAMESPACE}})
            runs: dict[str, list[dict[str, float]]] = {each.name: [] for each in order}
            for round_number in range(1, self._options.rounds + 1):
                for contestant in order:
                    say(f"round {round_number}: {contestant.name}")
                    figures = await self._drain(client, contestant)
                    if self._options.latency_pods:
                        figures |= await self._latency(client, contestant)
                    runs[contestant.name].append(figures)
                    say("  " + ", ".join(f"{name} {value:.3g}" for name, value in figures.items()))
        return self._result(order, runs)

    async def _drain(self, client: ApiClient, contestant: Contestant) -> dict[str, float]:
        options = self._options
        await load.hold_lease(client, contestant)
        names = [f"{contestant.name}-{index:05}" for index in range(options.pods)]
        await self._create(client, names, contestant)
        process = await asyncio.to_thread(contestants.start, self._cp, contestant)
        try:
            async with load.BoundWatch(client, NAMESPACE) as watch:
                await self._settle(process)
                events = await load.count_events(client, NAMESPACE)
                before = self._cpu(process)
                await load.drop_lease(client, contestant)
                await watch.until(options.pods, timeout_s=120 + options.pods / 20, progress=_progress(options.pods))
                await self._events_written(client, events + options.pods)
                after = self._cpu(process)
                rss_bytes = process.rss_bytes()
            seconds = max(watch.bound_s.values()) - min(watch.bound_s.values())
        finally:
            await asyncio.to_thread(process.stop)
        await load.delete_pods(client, NAMESPACE)
        per_pod = {f"{name} CPU ms/pod": 1000 * (after[name] - before[name]) / options.pods for name in before}
        return {"pods/s": (options.pods - 1) / seconds, **per_pod, "RSS MB": rss_bytes / 1e6}

    async def _latency(self, client: ApiClient, contestant: Contestant) -> dict[str, float]:
        options = self._options
        await load.drop_lease(client, contestant)
        process = await asyncio.to_thread(contestants.start, self._cp, contestant)
        created_s: dict[str, float] = {}
        try:
            async with load.BoundWatch(client, NAMESPACE) as watch:
                await self._create(client, ["warm-up"], contestant)
                await watch.until(1, timeout_s=60, progress=lambda _: None)
                start = time.monotonic()
                async with asyncio.TaskGroup() as group:
                    for index in range(options.latency_pods):
                        await asyncio.sleep(max(0.0, start + index / options.latency_rate - time.monotonic()))
                        group.create_task(self._timed(client, f"late-{index:05}", contestant, created_s))
                await watch.until(options.latency_pods + 1, timeout_s=120, progress=lambda _: None)
        finally:
            await asyncio.to_thread(process.stop)
        await load.delete_pods(client, NAMESPACE)
        waits = [1000 * (watch.bound_s[name] - when) for name, when in created_s.items()]
        return {f"create→bound p{percent} ms": percentile(waits, percent) for percent in (50, 99)}

    async def _timed(self, client: ApiClient, name: str, contestant: Contestant, created_s: dict[str, float]) -> None:
        # From before the request: on a busy machine its answer may be read after the watch has shown the bind.
        created_s[name] = time.monotonic()
        await client.create(PODS, self._make(name, contestant.scheduler_name), namespace=NAMESPACE)

    async def _create(self, client: ApiClient, names: Sequence[str], contestant: Contestant) -> None:
        async def create(name: str) -> None:
            await client.create(PODS, self._make(name, contestant.scheduler_name), namespace=NAMESPACE)

        await load.each(names, create)

    def _cpu(self, process: Process) -> dict[str, float]:
        return {
            "scheduler": process.cpu_seconds(),
            "API server": self._cp.process("kube-apiserver").cpu_seconds(),
            "etcd": self._cp.process("etcd").cpu_seconds(),
        }

    async def _settle(self, process: Process) -> None:
        """Wait until the scheduler has read the cluster: it uses less than 15 % of a core for a second."""
        deadline = time.monotonic() + 120
        before = process.cpu_seconds()
        while time.monotonic() < deadline:
            await asyncio.sleep(1.0)
            now = process.cpu_seconds()
            if now > 0.2 and now - before < 0.15:
                return
            before = now
        raise TimeoutError("the scheduler does not come to rest; its log: " + str(process.log_path))

    async def _events_written(self, client: ApiClient, wanted: int) -> None:
        """Both write one Event per pod behind the binds; their cost belongs to the pods."""
        deadline = time.monotonic() + 60
        while (found := await load.count_events(client, NAMESPACE)) < wanted:
            if time.monotonic() > deadline:
                say(f"  only {found} of {wanted} events were written")
                return
            await asyncio.sleep(0.2)

    def _result(self, order: Sequence[Contestant], runs: dict[str, list[dict[str, float]]]) -> dict[str, Any]:
        middle = {name: medians(found) for name, found in runs.items()}
        ratio = ratios(middle[order[0].name], middle[order[1].name]) if len(order) > 1 else {}
        options = {name: getattr(self._options, name) for name in Options.__slots__}
        machine = {"python": platform.python_version(), "machine": platform.machine()}
        return {"options": options, "machine": machine, "runs": runs, "median": middle, "ratio": ratio}


def _progress(total: int) -> Any:
    if not sys.stderr.isatty():
        return lambda _: None

    def show(count: int) -> None:
        print(f"\r  {count}/{total} bound", end="\n" if count == total else "", file=sys.stderr, flush=True)

    return show


if __name__ == "__main__":
    sys.exit(main())
