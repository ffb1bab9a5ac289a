"""Thousands of simulated node agents write to one real API server: writes per second, their cost, and what a start or an outage does.

Every agent runs the product's own code from readings to requests (what is a change, when to write, the writer, the list of peers);
only its sockets and files are simulated. All share this process and a pool of connections.
"""

import argparse
import asyncio
import itertools
import json
import logging
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from tests.support import crds

from campaigns.common.figures import percentile
from campaigns.common.options import amount, count, report
from campaigns.common.process_use import cpu_seconds
from robotapp_agent.devices.device import Device
from robotapp_agent.probe.rounds import RoundResult
from robotapp_agent.process.parts import SAMPLE_S
from robotapp_agent.process.run import START_SPREAD_S, first_write_s, look_around
from robotapp_agent.report.changes import ROUND_JITTER, Pace, round_s
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.report.load import CpuTimes, Sample, Traffic
from robotapp_agent.report.status import Status
from robotapp_agent.shell.api_writer import ApiWriter
from robotapp_agent.shell.endpoints import Endpoints
from robotapp_agent.shell.own_node import OwnNode
from robotapp_agent.shell.reporter import Reporter
from robotapp_client import ApiClient, ClientError, load
from robotapp_client.api.resources import ENDPOINTSLICES, NODETELEMETRIES
from robotapp_testbed import ControlPlane

PER_SLICE: Final = 100
PEERS: Final = 16
PROBES: Final = 10
CONNECTIONS: Final = 128
STALL_S: Final = 0.5
"""A machine that lets the bench or the API server wait longer has writes pile up: their busiest second tells nothing of the agents."""
_TICK_S: Final = 0.05
CAMERA: Final = Device(id="usb-8086-0b3a-0123", type="usb", identity="8086:0b3a:0123", path="/dev/video0")


@dataclass
class Ledger:
    """Every write by all agents: when it was sent, and how long its answer took."""

    sent_s: list[float] = field(default_factory=list)
    took_s: list[float] = field(default_factory=list)
    failed: Counter[str] = field(default_factory=Counter)

    def between(self, begin_s: float, end_s: float) -> list[float]:
        return [at_s for at_s in self.sent_s if begin_s <= at_s < end_s]

    def busiest_second(self, begin_s: float, end_s: float) -> int:
        return max(Counter(int(at_s - begin_s) for at_s in self.between(begin_s, end_s)).values(), default=0)


class CountingWriter(ApiWriter):
    """The product's writer; the ledger sees every write."""

    ledger: Ledger

    async def write(self, status: Status) -> tuple[str, ...]:
        began_s = time.monotonic()
        self.ledger.sent_s.append(began_s)
        try:
            return await super().write(status)
        except ClientError as error:
            self.ledger.failed[reason_of(error)] += 1
            raise
        finally:
            self.ledger.took_s.append(time.monotonic() - began_s)


def reason_of(error: ClientError) -> str:
    """The same for all agents: without the path of the request."""
    return f"{type(error).__name__}: {str(error).rpartition('/status: ')[2][:80]}"


class SimulatedNode:
    """What the files and sockets of a node would give: a load that swings by `noise` of itself, and round trips that do as well."""

    def __init__(self, number: int, *, noise: float, nodes: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._chance = random.Random(number)
        self._noise = noise
        self._cpu = self._chance.uniform(0.05, 0.7)
        self._memory = self._chance.uniform(10, 80)
        self._ticks = CpuTimes(0, 0)
        self._bytes = 0
        self._at_s = clock()
        self._peers = {f"node-{self._chance.randrange(nodes)}": self._chance.uniform(200, 40_000) for _ in range(PEERS)}

    def sample(self) -> Sample:
        now_s = self._clock()
        total = max(1, int((now_s - self._at_s) * 100))
        busy = self._cpu * max(0.0, self._chance.gauss(1, self._noise))
        self._ticks = CpuTimes(self._ticks.busy + int(total * min(1.0, busy)), self._ticks.total + total)
        self._bytes += int(500_000 * max(0.0, self._chance.gauss(1, self._noise)) * (now_s - self._at_s))
        self._at_s = now_s
        traffic = {"eth0": Traffic(self._bytes, 0)}
        return Sample(now_s, cpu=self._ticks, memory_percent=round(self._memory), disk_percent=40, traffic=traffic)

    def round(self) -> list[RoundResult]:
        return [self._result(peer, base_us) for peer, base_us in self._peers.items()]

    def _result(self, peer: str, base_us: float) -> RoundResult:
        times = sorted(int(base_us * max(0.5, self._chance.gauss(1, self._noise))) for _ in range(PROBES))
        return RoundResult(peer, times[PROBES // 2], times[-1], int(base_us * self._noise), 0, PROBES, PROBES)


class SimulatedAgent:
    """As `robotapp_agent.process.run`, without sockets and files."""

    def __init__(self, number: int, client: ApiClient, ledger: Ledger, options: argparse.Namespace) -> None:
        self._node = SimulatedNode(number, noise=options.noise, nodes=options.agents)
        self._knowledge = Knowledge(arch="arm64", realtime=False, seq=0)
        self._knowledge.devices = (CAMERA,)
        self._writer = CountingWriter(client, lambda: OwnNode(f"node-{number}"), offset=self._knowledge.offset)
        self._writer.ledger = ledger
        self._peers = Endpoints(client, namespace="default", service="robotapp-agent", uniform=random.random)
        self._peers.changed = self._counted
        self._lists: bool = options.lists
        self._reporter: Reporter | None = None

    async def run(self) -> None:
        await asyncio.sleep(START_SPREAD_S * random.random())
        await look_around(self._writer, self._peers)
        self._knowledge.nodes = self._peers.nodes
        self._knowledge.sampled(self._node.sample())
        self._reporter = Reporter(
            self._writer,
            self._knowledge.readings,
            pace=Pace(first_s=time.monotonic() + first_write_s(self._knowledge.nodes), uniform=random.random),
            asked=lambda _: None,
            clock=time.monotonic,
            uniform=random.random,
        )
        async with asyncio.TaskGroup() as group:
            group.create_task(self._reporter.run())
            if self._lists:
                group.create_task(self._peers.run())
            group.create_task(self._sample(self._reporter))
            group.create_task(self._measure(self._reporter))

    async def _sample(self, reporter: Reporter) -> None:
        while True:
            await asyncio.sleep(SAMPLE_S)
            self._knowledge.sampled(self._node.sample())
            reporter.wake()

    async def _measure(self, reporter: Reporter) -> None:
        for ended in itertools.count():
            interval_s = float(self._knowledge.interval_s)
            seconds = round_s(ended=ended, interval_s=interval_s, uniform=random.random)
            await asyncio.sleep(seconds)
            self._knowledge.round_ended(self._node.round(), every_rounds={})
            reporter.wake()
            await asyncio.sleep(seconds * ROUND_JITTER * random.random())

    def _counted(self) -> None:
        """5000 agents in one process cannot keep 5000 lists of 5000 peers."""
        self._knowledge.nodes = self._peers.nodes
        self._peers.peers = {}


@dataclass(frozen=True)
class Mark:
    """Counters at one moment."""

    at_s: float
    server_s: float
    etcd_s: float
    requests: int


class Bench:
    def __init__(self, plane: ControlPlane, client: ApiClient, options: argparse.Namespace) -> None:
        self._plane = plane
        self._client = client
        self._options = options
        self.ledger = Ledger()
        self._late_s = 0.0

    async def _watch_lateness(self) -> None:
        """Keep the longest time that this process was not run."""
        while True:
            due_s = time.monotonic() + _TICK_S
            await asyncio.sleep(_TICK_S)
            self._late_s = max(self._late_s, time.monotonic() - due_s)

    async def run(self) -> list[dict[str, Any]]:
        options, client = self._options, self._client
        await self._publish()
        began = self._mark()
        agents = [SimulatedAgent(number, client, self.ledger, options) for number in range(options.agents)]
        tasks = [asyncio.create_task(agent.run()) for agent in agents]
        tasks.append(asyncio.create_task(self._watch_lateness()))
        interval_s = max(10, options.agents / 50)
        rows = [await self._phase("start", began, START_SPREAD_S + 1.2 * interval_s)]
        rows += [await self._phase("steady", self._mark(), options.seconds)]
        if options.outage:
            rows += await self._outage(interval_s)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return rows

    async def _outage(self, interval_s: float) -> list[dict[str, Any]]:
        server = self._plane.process("kube-apiserver")
        server.kill()
        away = await self._phase("away", self._mark(), self._options.outage)
        await asyncio.to_thread(lambda: server.start().wait_ready())
        return [away, await self._phase("return", self._mark(), 2 * interval_s)]

    async def _phase(self, name: str, before: Mark, seconds: float) -> dict[str, Any]:
        own_s, self._late_s = time.process_time(), 0.0
        await asyncio.sleep(before.at_s + seconds - time.monotonic())
        after = self._mark()
        elapsed_s = after.at_s - before.at_s
        writes = len(self.ledger.between(before.at_s, after.at_s))
        server_s = max(0.0, after.server_s - before.server_s)
        took = self.ledger.took_s[-writes:] if writes else []
        return {
            "phase": name,
            "seconds": round(elapsed_s),
            "writes": writes,
            "writes_per_s": round(writes / elapsed_s, 1),
            "busiest_second": self.ledger.busiest_second(before.at_s, after.at_s),
            "stalled_s": round(self._late_s, 2),
            "requests": after.requests - before.requests,
            "p99_ms": round(1000 * percentile(took, 99), 1) if took else None,
            "api_server_cores": round(server_s / elapsed_s, 2),
            "api_server_ms_per_write": round(1000 * server_s / writes, 1) if writes else None,
            "etcd_cores": round(max(0.0, after.etcd_s - before.etcd_s) / elapsed_s, 2),
            "bench_cores": round((time.process_time() - own_s) / elapsed_s, 2),
            "failed": dict(self.ledger.failed),
        }

    def _mark(self) -> Mark:
        server, etcd = (self._plane.process(name) for name in ("kube-apiserver", "etcd"))
        return Mark(
            time.monotonic(),
            cpu_seconds(server.pid) if server.running else 0.0,
            cpu_seconds(etcd.pid),
            self._client.requests.total(),
        )

    async def _publish(self) -> None:
        """The EndpointSlices of all agents, as Kubernetes would cut them."""
        names = [f"node-{number}" for number in range(self._options.agents)]
        for first in range(0, len(names), PER_SLICE):
            part = names[first : first + PER_SLICE]
            endpoints = [
                {"addresses": [f"10.{first % 250}.{number}.1"], "nodeName": name, "zone": f"zone-{first // 1000}"}
                for number, name in enumerate(part)
            ]
            labels = {"kubernetes.io/service-name": "robotapp-agent"}
            metadata = {"name": f"agents-{first}", "namespace": "default", "labels": labels}
            body = {"metadata": metadata, "addressType": "IPv4", "endpoints": endpoints, "ports": []}
            await self._client.create(ENDPOINTSLICES, body)


async def measured(plane: ControlPlane, options: argparse.Namespace) -> tuple[list[dict[str, Any]], int]:
    endpoint = load(Path(plane.kubeconfig()))
    async with ApiClient(endpoint, user_agent="bench-agents", max_connections=CONNECTIONS) as client:
        rows = await Bench(plane, client, options).run()
        return rows, len((await client.list(NODETELEMETRIES)).items)


def verdict(rows: Sequence[dict[str, Any]], objects: int, options: argparse.Namespace) -> list[str]:
    """What does not hold."""
    steady = next(row for row in rows if row["phase"] == "steady")
    start = next(row for row in rows if row["phase"] == "start")
    wrong = []
    if steady["writes_per_s"] > options.limit:
        wrong.append(f"{steady['writes_per_s']} writes/s in steady state, allowed are {options.limit}")
    if start["busiest_second"] > 2 * options.limit and not stalled(start):
        wrong.append(f"{start['busiest_second']} writes in one second of the start")
    if objects != options.agents:
        wrong.append(f"{objects} of {options.agents} agents have an object")
    return wrong


def stalled(row: dict[str, Any]) -> bool:
    """Whether the machine kept the bench or the API server waiting in this phase."""
    return row["stalled_s"] > STALL_S or (row["p99_ms"] or 0) > 1000 * STALL_S


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench agents", description=__doc__)
    parser.add_argument("--agents", type=count(1, 20_000), default=5000)
    parser.add_argument("--seconds", type=count(1), default=240, help="of steady state; default: 240")
    parser.add_argument(
        "--noise", type=amount, default=0.1, help="standard deviation of load and round trips; default: 0.1"
    )
    parser.add_argument("--outage", type=count(0), default=0, help="seconds without API server after that; default: 0")
    parser.add_argument("--limit", type=amount, default=50.0, help="writes per second of all; default: 50")
    lists = "agents read the list of agents: with 5000 that is half of the CPU of both sides, and needs a machine without other work"
    parser.add_argument("--lists", action=argparse.BooleanOptionalAction, default=True, help=lists)
    parser.add_argument("--json", type=report)
    options = parser.parse_args(arguments)
    logging.getLogger("robotapp_agent").setLevel(logging.CRITICAL)  # thousands would report the same outage
    with ControlPlane(kwok=False, controller_manager=False) as plane:
        crds.install(plane)
        rows, objects = asyncio.run(measured(plane, options))
    for row in rows:
        print("  ".join(f"{name}={value}" for name, value in row.items()), flush=True)
    if options.json:
        options.json.write_text(
            json.dumps({"agents": options.agents, "noise": options.noise, "phases": rows}, indent=2)
        )
    if stalled(rows[0]):
        print(
            "this machine stood still meanwhile: the busiest second is not judged, scripts/bench agents_schedule tells it"
        )
    wrong = verdict(rows, objects, options)
    print("; ".join(wrong) if wrong else f"{objects} agents: as intended")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
