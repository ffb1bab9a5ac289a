"""Nodes without kubelets whose agents probe each other through the latency switch, for tests and measurements."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from math import comb
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, Self

from campaigns.network.namespaced import Namespace, Wire, round_trips_ms
from robotapp_agent.probe.rounds import RoundResult

PORT = 8600
_REPOSITORY = Path(__file__).parents[3]


class Measured(NamedTuple):
    """One round. `cpu_s`: what the agent's process used meanwhile."""

    results: Mapping[str, RoundResult]
    silent: tuple[str, ...]
    discarded: str
    cpu_s: float


class ProbingNode:
    """The probing half of an agent in a namespace."""

    def __init__(self, node: Namespace) -> None:
        self.node = node
        argv = ["nsenter", f"--target={node.pid}", "--net", sys.executable, "-m", "campaigns.network.probing_node"]
        self._process = subprocess.Popen(
            [*argv, node.name, str(PORT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=_REPOSITORY
        )
        assert self._line() == {}

    def round(self, peers: Mapping[str, str], *, seconds: float) -> Measured:
        """Measure the peers by name at these addresses."""
        assert self._process.stdin
        self._process.stdin.write(json.dumps({"peers": peers, "seconds": seconds}) + "\n")
        self._process.stdin.flush()
        answer = self._line()
        results = {peer: RoundResult(**result) for peer, result in answer["results"].items()}
        return Measured(results, tuple(answer["silent"]), answer["discarded"], answer["cpu_s"])

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """The process stands still, as in a suspended machine."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End the process."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.close()
        self._process.wait(60)
        self._process.stdout.close()

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer


class ProbingNodes:
    """`with ProbingNodes(["a", "b"]) as nodes:` a wire with an agent on each node."""

    def __init__(self, names: list[str], *, seed: int = 0) -> None:
        self.wire = Wire(names, seed=seed)
        self.nodes: dict[str, ProbingNode] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.wire)
            self.wire.settle()
            for name, node in self.wire.nodes.items():
                self.nodes[name] = ProbingNode(node)
                stack.callback(self.nodes[name].stop)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def round(self, origin: str, *, seconds: float, addresses: Mapping[str, str] | None = None) -> Measured:
        """One round from a node to all others, or to these addresses."""
        others = {name: node.address for name, node in self.wire.nodes.items() if name != origin}
        return self.nodes[origin].round(others if addresses is None else addresses, seconds=seconds)

    def round_beside_ping(self, origin: str, *, seconds: float) -> tuple[Measured, dict[str, float]]:
        """One round to all others, and the median in microseconds that ping sees to each of them meanwhile."""
        near = self.wire.nodes[origin]
        with ThreadPoolExecutor() as pool:
            pings: dict[str, Future[list[float]]] = {
                name: pool.submit(round_trips_ms, near, far, count=int(seconds * 10), pause_s=0.1)
                for name, far in self.wire.nodes.items()
                if name != origin
            }
            measured = self.round(origin, seconds=seconds)
        return measured, {name: median(ping.result()) * 1000 for name, ping in pings.items()}


def is_as_ping(p50_us: int | None, ping_us: float) -> bool:
    """Within 10 % and 0.3 ms of the median of ping."""
    return p50_us is not None and abs(p50_us - ping_us) <= 0.1 * ping_us + 300


def is_likely(lost: int, sent: int, share: float, *, level: float = 0.99) -> bool:
    """Does the number of losses lie within the binomial interval of this level for a link that loses `share`?"""
    rest = (1 - level) / 2
    below = sum(_probability(count, sent, share) for count in range(lost + 1))
    above = 1 - below + _probability(lost, sent, share)
    return below > rest and above > rest


def _probability(lost: int, sent: int, share: float) -> float:
    return float(comb(sent, lost) * share**lost * (1 - share) ** (sent - lost))
