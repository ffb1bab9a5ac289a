"""Our scheduler, kube-scheduler and a bare client in turn on one live control plane: pods/s, CPU per pod, latency, verdicts.

Per row (--workload, repeatable, default all) and round the contestants take turns, each in a fresh process:
- drain: all pods exist and the caches are warm before the clock starts; it runs from a scheduler's first write to one of them
  until the last one is bound and its Event written. CPU is counted over the same time, of the scheduler's own processes.
- latency: pods are created at a fixed rate; each is timed from sending its creation until a watch shows it bound.
The bare client does the same writes without deciding anything, as the same user: it is what this machine and API server allow.
(A cluster admin's requests skip the API server's rules of access, which are a twentieth of its instructions per pod.)

The contestants see the same cluster with these differences: each has its own schedulerName; kube-scheduler gets fewer pods
where it is an order of magnitude slower (--vs-pods); where pods wait, each contestant gets its own waiters, has refused them
all before, and stands still (SIGSTOP) while the measured pods are created, elsewhere a lease holds it back; what preemption
and churn removed is put back before the next contestant; the bare client refuses nobody.
"""

import argparse
import asyncio
import contextlib
import os
import platform
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from campaigns.common.output import say
from campaigns.scheduler import load
from campaigns.speed.console import line, print_table, show
from campaigns.speed.contestants import BARE, BARE_NO_EVENTS, CONTESTANTS, KUBE_SCHEDULER, OURS, Contestant
from campaigns.speed.result import Result, Row
from campaigns.speed.run import Case, Rates, Run, pods_for
from campaigns.speed.scenery import Scenery, Size
from campaigns.speed.workloads import WORKLOADS, Workload
from robotapp_client.api.client import ApiClient
from robotapp_client.transport.kubeconfig import load as login
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import install

API_SERVER = ("--disable-admission-plugins=TaintNodesByCondition", "--delete-collection-workers=16")
"""New nodes are ready at once, and thousands of pods are gone soon."""


@dataclass(frozen=True, slots=True)
class Options:
    """What is measured; None leaves the number of pods to the workload."""

    workloads: tuple[str, ...]
    contestants: tuple[str, ...]
    nodes: int = 5000
    prebound: int = 30000
    pods: int | None = None
    vs_pods: int | None = None
    rounds: int = 2
    latency_pods: int = 600
    latency_rate: float = 300.0


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    options = _options(arguments)
    command = _command(sys.argv[1:] if argv is None else argv)
    machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": str(os.cpu_count())}
    result = Result(command, asdict(options), machine)
    with plane() as cp:
        logs = cp.keep_logs()
        try:
            asyncio.run(Bench(cp, options).run(result.rows))
        finally:
            if arguments.json:
                result.write(arguments.json)
            say(f"logs: {logs}")
    print_table(result.rows)
    return int(arguments.check and not all(row.verdict().met for row in result.rows))


def _command(given: Sequence[str]) -> str:
    """How to measure the same again; where one wanted the file is one's own affair."""
    kept = [word for before, word in pairwise(["", *given]) if "--json" not in (before, word)]
    return shlex.join(["scripts/bench", "scheduler", *kept])


@contextlib.contextmanager
def plane() -> Iterator[ControlPlane]:
    """etcd, an API server that deletes quickly, and our roles: no controller and no kubelet takes CPU from the contestants."""
    with ControlPlane(kwok=False, controller_manager=False, extra_args={"kube-apiserver": API_SERVER}) as cp:
        install(cp)
        yield cp


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="scripts/bench scheduler", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    texts = "\n".join(f"  {each.name:24}{each.text}" for each in WORKLOADS.values())
    parser.epilog = f"workloads:\n{texts}"
    parser.add_argument("--vs", choices=[KUBE_SCHEDULER.name], help="measure this scheduler in turn with ours")
    parser.add_argument("--workload", action="append", choices=[*WORKLOADS, "all"], help="repeatable; default all")
    parser.add_argument("--without", action="append", default=[], choices=list(CONTESTANTS), help="leave one out")
    parser.add_argument("--nodes", type=int, default=5000)
    parser.add_argument("--prebound", type=int, default=30000, help="pods bound beforehand")
    parser.add_argument("--pods", type=int, help="pods per run; default by workload, 500 to 3000")
    parser.add_argument("--vs-pods", type=int, help="pods per run for kube-scheduler; default by workload")
    parser.add_argument("--rounds", type=int, default=2, help="runs per contestant; medians are reported")
    parser.add_argument("--latency-pods", type=int, default=600, help="0 leaves the latency part out")
    parser.add_argument("--latency-rate", type=float, default=300.0, help="pods created per second")
    parser.add_argument("--json", type=Path, help="write every figure to this file")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a row misses its target")
    return parser


def _options(arguments: argparse.Namespace) -> Options:
    chosen = arguments.workload or ["all"]
    order = [OURS, *([KUBE_SCHEDULER] if arguments.vs else []), BARE, BARE_NO_EVENTS]
    return Options(
        workloads=tuple(name for name in WORKLOADS if "all" in chosen or name in chosen),
        contestants=tuple(each.name for each in order if each.name not in arguments.without),
        nodes=arguments.nodes,
        prebound=arguments.prebound,
        pods=arguments.pods,
        vs_pods=arguments.vs_pods,
        rounds=arguments.rounds,
        latency_pods=arguments.latency_pods,
        latency_rate=arguments.latency_rate,
    )


class Bench:
    """One control plane, all rows."""

    def __init__(self, cp: ControlPlane, options: Options) -> None:
        self._cp = cp
        self._options = options

    async def run(self, rows: list[Row]) -> None:
        """Add row after row to `rows`, each as soon as it is begun."""
        options = self._options
        size = Size(options.nodes, options.prebound)
        endpoint = await asyncio.to_thread(login, self._cp.kubeconfig("admin"))
        async with ApiClient(endpoint, user_agent="robotapp-bench", max_connections=load.CONNECTIONS) as client:
            scenery = Scenery(client, size, say)
            await scenery.build()
            run = Run(self._cp, client, scenery, size, Rates(options.latency_pods, options.latency_rate))
            for name in options.workloads:
                row = Row(name)
                rows.append(row)
                await scenery.set_up(WORKLOADS[name])
                for round_number in range(1, options.rounds + 1):
                    for contestant in options.contestants:
                        say(f"{name}, round {round_number}: {contestant}")
                        await self._once(run, WORKLOADS[name], CONTESTANTS[contestant], row)
                await scenery.take_down(WORKLOADS[name])

    async def _once(self, run: Run, workload: Workload, contestant: Contestant, row: Row) -> None:
        pods = pods_for(workload, contestant, pods=self._options.pods, vs_pods=self._options.vs_pods)
        figures = await run.measure(Case(workload, contestant, pods), show)
        row.add(contestant.name, pods, figures)
        say(f"  {pods} pods: {line(figures)}")


if __name__ == "__main__":
    sys.exit(main())
