"""The whole agent of one node: finds out who and where it is, then runs its parts until it is told to stop."""

import asyncio
import contextlib
import logging
import os
import platform
import random
import signal
import time
from collections.abc import Awaitable, Callable, Iterable
from math import inf
from pathlib import Path
from typing import Final

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.process import parts
from robotapp_agent.process.health import Health
from robotapp_agent.process.supervision import supervised
from robotapp_agent.report.changes import NODES_PER_SECOND, Pace
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.shell.api_writer import ApiWriter, Earlier
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_agent.shell.endpoints import Endpoints
from robotapp_agent.shell.feature_file import FeatureFile
from robotapp_agent.shell.host.node_files import NodeFiles
from robotapp_agent.shell.options import Options
from robotapp_agent.shell.own_node import OwnNode, own_node
from robotapp_agent.shell.reporter import Reporter
from robotapp_client.api.client import ApiClient
from robotapp_client.transport.errors import ClientError
from robotapp_client.transport.kubeconfig import SERVICE_ACCOUNT, Endpoint, load

log = logging.getLogger(__name__)

START_SPREAD_S: Final = 5.0
"""A new version starts on all nodes at once: the first request of each agent comes within this time."""
READS_PER_SECOND: Final = 500
"""Of all agents together, when they start."""
LOOK_S: Final = 10.0
PATIENCE_S: Final = 5.0
CONNECTIONS: Final = 2
REQUEST_S: Final = 20.0
ARCHITECTURES: Final = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "arm", "i686": "386"}
"""As Kubernetes names them in the label kubernetes.io/arch; others have one name."""


async def run(options: Options) -> int:
    """Run until SIGTERM or SIGINT. Raises LoginError and UnknownNodeError."""
    endpoint = load(options.kubeconfig)
    node = node_source(options.kubeconfig, options.node_name)
    log.info("the agent of node %s starts, API server %s", node().name, endpoint.server)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    client = ApiClient(endpoint, user_agent="robotapp-agent", max_connections=CONNECTIONS, timeout_s=REQUEST_S)
    async with client:
        work = asyncio.create_task(_work(options, endpoint, client, node))
        stopped = asyncio.create_task(stop.wait())
        await asyncio.wait((work, stopped), return_when=asyncio.FIRST_COMPLETED)
        for task in (work, stopped):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await work
    return 0


def node_source(kubeconfig: Path | None, node_name: str) -> Callable[[], OwnNode]:
    """Reads the token anew each time, because the kubelet replaces it."""
    token = None if kubeconfig else SERVICE_ACCOUNT / "token"
    return lambda: own_node(token, flag=node_name, environment=os.environ.get("NODE_NAME", ""))


async def _work(options: Options, endpoint: Endpoint, client: ApiClient, node: Callable[[], OwnNode]) -> None:
    await asyncio.sleep(min(START_SPREAD_S, options.interval_seconds or START_SPREAD_S) * random.random())  # noqa: S311 - spreads load
    files = NodeFiles(options.host_root)
    knowledge = Knowledge(
        arch=architecture(),
        realtime=files.realtime(),
        seq=int(time.time()),
        fixed_interval_s=options.interval_seconds,
    )
    writer = ApiWriter(client, node, offset=knowledge.offset)
    peers = Endpoints(
        client, namespace=options.namespace or endpoint.namespace, service=options.service, uniform=random.random
    )
    earlier = await look_around(writer, peers)
    knowledge.nodes = peers.nodes
    if earlier is not None:
        knowledge.seq = earlier.seq
    await NodeAgent(
        options, knowledge, writer=writer, peers=peers, files=files, node=node().name, earlier=earlier or Earlier()
    ).work()


async def look_around(writer: ApiWriter, peers: Endpoints) -> Earlier | None:
    """What an earlier run left, and the size of the cluster. None when the API server does not tell soon: an agent that cannot
    reach it answers the probes of others all the same.
    """
    try:
        async with asyncio.timeout(LOOK_S):
            await peers.count()
        await asyncio.sleep(peers.nodes / READS_PER_SECOND * random.random())  # noqa: S311 - spreads load
        async with asyncio.timeout(LOOK_S):
            return await writer.earlier()
    except (ClientError, TimeoutError) as error:
        log.warning(
            "the agent begins without what the API server knows: %s", str(error) or f"no answer in {LOOK_S:.0f} s"
        )
        return None


def first_write_s(nodes: int, *, uniform: Callable[[], float] = random.random) -> float:
    """How long a new agent waits: all agents together begin as slowly as they go on."""
    return nodes / NODES_PER_SECOND * uniform()


def architecture() -> str:
    """Of the node, as Kubernetes names it."""
    machine = platform.machine()
    return ARCHITECTURES.get(machine, machine)[:32]


class NodeAgent:
    """The parts and what they share."""

    def __init__(
        self,
        options: Options,
        knowledge: Knowledge,
        *,
        writer: ApiWriter,
        peers: Endpoints,
        files: NodeFiles,
        node: str,
        earlier: Earlier,
    ) -> None:
        self._options = options
        self._knowledge = knowledge
        self._peers = peers
        self._files = files
        self._keys = KeyRing()
        self._ending = False
        self._scanner = DeviceScanner(
            HostPaths.below(options.host_root),
            rules_path=options.device_rules,
            node=node,
            reported=earlier.devices,
            cancelled=lambda: self._ending,
        )
        self._features = None if options.features_dir is None else FeatureFile(options.features_dir)
        self._reporter = Reporter(
            writer,
            knowledge.readings,
            pace=Pace(first_s=time.monotonic() + first_write_s(knowledge.nodes), uniform=random.random),
            asked=self._asked,
            clock=time.monotonic,
            uniform=random.random,
        )
        self._rounds = parts.Rounds(node, knowledge, self._wake, peers=lambda: peers.peers, look_again=peers.look_again)
        self._first = asyncio.Event()
        peers.changed = self._counted

    def __repr__(self) -> str:
        return f"<NodeAgent {self._knowledge!r}, {self._reporter!r}>"

    async def work(self) -> None:
        """Run all parts until cancelled. A scan that is under way in its thread ends then as well, or the process would wait."""
        try:
            async with asyncio.TaskGroup() as group:
                for name, part in self._parts():
                    group.create_task(supervised(name, part, clock=time.monotonic), name=name)
        finally:
            self._ending = True

    def _parts(self) -> Iterable[tuple[str, Callable[[], Awaitable[None]]]]:
        options, knowledge, wake = self._options, self._knowledge, self._wake
        yield "load", lambda: parts.sample_load(self._files, knowledge, wake)
        period_s = options.interval_seconds or inf
        yield "devices", lambda: parts.scan_devices(self._scanner, self._features, knowledge, wake, period_s=period_s)
        yield "peers", self._peers.run
        yield "report", self._report
        if options.key_dir is not None and options.probe_port:
            key_dir = options.key_dir
            yield "keys", lambda: parts.read_keys(self._keys, key_dir)
            yield "round trips", lambda: self._rounds.probe(self._keys, options.probe_port)
        else:
            yield "rounds", self._rounds.idle
        if options.health_port:
            yield "health", lambda: Health(self.silent).serve(options.health_port)

    async def _report(self) -> None:
        """The first write waits for devices and load, which saves a second one."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE_S):
                await self._first.wait()
        await self._reporter.run()

    def _wake(self) -> None:
        if self._knowledge.complete:
            self._first.set()
        self._reporter.wake()

    def silent(self) -> list[str]:
        """Parts that stand still. Not those that wait for the API server or a device: another start would not help them."""
        since_s = time.monotonic() - self._rounds.ended_s
        return ["rounds"] if since_s > 3 * self._knowledge.interval_s + 60 else []

    def _asked(self, names: tuple[str, ...]) -> None:
        self._rounds.asked = names
        self._peers.look_for(names)

    def _counted(self) -> None:
        self._knowledge.nodes = self._peers.nodes
