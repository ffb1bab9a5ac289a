"""The parts of the agent, each a loop of its own: what one finds out goes into `Knowledge`, and the reporter is woken."""

import asyncio
import logging
import random
import time
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Final

from robotapp_agent.probe.keys import KeyRing
from robotapp_agent.probe.peers import choose_peers
from robotapp_agent.report.changes import ROUND_JITTER, round_s
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.shell.device_scanner import DeviceScanner
from robotapp_agent.shell.endpoints import Peer
from robotapp_agent.shell.feature_file import FeatureFile
from robotapp_agent.shell.host.node_files import NodeFiles
from robotapp_agent.shell.key_files import refresh_keys
from robotapp_agent.shell.udp import PeerAddress, UdpProbes

log = logging.getLogger(__name__)

SAMPLE_S: Final = 10.0
KEYS_S: Final = 10.0

Wake = Callable[[], None]


async def sample_load(files: NodeFiles, knowledge: Knowledge, wake: Wake) -> None:
    """Load, temperatures and batteries, in a thread: a slow sensor must not make round trips look long."""
    while True:
        sample = await asyncio.to_thread(files.sample)
        knowledge.sampled(sample.load)
        knowledge.temperatures, knowledge.battery = sample.temperatures, sample.battery
        wake()
        await asyncio.sleep(SAMPLE_S)


async def scan_devices(
    scanner: DeviceScanner, features: FeatureFile | None, knowledge: Knowledge, wake: Wake, *, period_s: float = inf
) -> None:
    """Devices, in a thread as well, and their labels for Node Feature Discovery. A problem is logged when it is a new one.

    period_s: scan at least this often, whatever the scanner proposes.
    """
    said = ("", "")
    while True:
        scan = await asyncio.to_thread(scanner.scan)
        if features is not None:
            await asyncio.to_thread(features.write, scan.devices)
        problems = (scan.problem, features.problem if features is not None else "")
        for problem, before in zip(problems, said, strict=True):
            if problem and problem != before:
                log.warning("devices: %s", problem)
        said = problems
        knowledge.devices, knowledge.device_problem = scan.devices, scan.problem
        wake()
        await asyncio.sleep(min(scan.next_s, period_s))


async def read_keys(ring: KeyRing, folder: Path) -> None:
    """Follow the Secret with the keys of the probes."""
    said: tuple[str, ...] = ()
    while True:
        problems = refresh_keys(ring, folder, now_s=time.monotonic())
        if problems != said:
            for problem in problems:
                log.warning("keys of the probes: %s", problem)
        said = problems
        await asyncio.sleep(KEYS_S)


class Rounds:
    """Measures one round of probes after the other.

    `peers` are the agents by node, `asked` the nodes that spec.probe names. A peer with several addresses is probed at one of
    them, and at the next one after a round without an answer. `look_again` is called when a peer answers no longer: its agent may
    have restarted at another address, which has to be known before its next round, or the peer would be reported as unreachable.
    """

    def __init__(
        self,
        node: str,
        knowledge: Knowledge,
        wake: Wake,
        *,
        peers: Callable[[], Mapping[str, Peer]],
        look_again: Callable[[], None],
        uniform: Callable[[], float] = random.random,
    ) -> None:
        self.asked: tuple[str, ...] = ()
        self.ended_s = time.monotonic()
        """When the last round ended, for the liveness check."""
        self._node = node
        self._knowledge = knowledge
        self._wake = wake
        self._peers = peers
        self._look_again = look_again
        self._uniform = uniform
        self._rounds = 0
        self._turns: dict[str, int] = {}
        self._discarded = ""

    def __repr__(self) -> str:
        return f"<Rounds of {self._node}: round {self._knowledge.seq}>"

    async def probe(self, keys: KeyRing, port: int) -> None:
        """Answer other agents and measure, for ever. A port that cannot be opened ends one round, which then counts as idle."""
        try:
            async with UdpProbes(own_name=self._node, keys=keys, port=port) as probes:
                while True:
                    await self._round(probes)
        except OSError as error:
            log.warning("no round trips are measured: UDP port %d: %s", port, error)
            await self._idle_round()

    async def idle(self) -> None:
        """Count rounds without measuring, where probes are switched off."""
        while True:
            await self._idle_round()

    async def _round(self, probes: UdpProbes) -> None:
        peers = self._peers()
        zones = {name: peer.zone for name, peer in peers.items()}
        chosen = choose_peers(self._node, zones=zones, asked=self.asked, round_number=self._knowledge.seq)
        addresses = [PeerAddress(peer.name, self._address(peer.name, peers[peer.name])) for peer in chosen]
        seconds = self._seconds()
        measured = await probes.round(addresses, seconds=seconds)
        if measured.discarded and measured.discarded != self._discarded:
            log.info("rounds of probes do not count: %s", measured.discarded)
        self._discarded = measured.discarded
        unreachable = (result.peer for result in measured.results if result.p50_us is None)
        for name in (*measured.silent, *unreachable):
            self._turns[name] = self._turns.get(name, 0) + 1
        if measured.silent:
            self._look_again()
        self._turns = {name: turn for name, turn in self._turns.items() if name in peers}
        results = () if measured.discarded else measured.results
        self._knowledge.round_ended(results, every_rounds={peer.name: peer.every_rounds for peer in chosen})
        self._ended()
        await asyncio.sleep(seconds * ROUND_JITTER * self._uniform())

    def _address(self, name: str, peer: Peer) -> str:
        return peer.addresses[self._turns.get(name, 0) % len(peer.addresses)]

    def _seconds(self) -> float:
        return round_s(ended=self._rounds, interval_s=float(self._knowledge.interval_s), uniform=self._uniform)

    async def _idle_round(self) -> None:
        await asyncio.sleep(self._seconds())
        self._knowledge.idle_round()
        self._ended()

    def _ended(self) -> None:
        self._rounds += 1
        self.ended_s = time.monotonic()
        self._wake()
