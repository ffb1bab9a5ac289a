"""The agent's probes between namespaces behind the latency switch: how near they are to ping and to the set loss, and their cost.

Needs root and a quiet machine. Four minutes; `--long` twenty.
"""

import argparse
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from math import comb
from pathlib import Path
from statistics import mean, median
from typing import Any, NamedTuple, Self

from tests.support.agent.probes import prober, request_of, responder, ring

from campaigns.common import options
from campaigns.network.namespaced import Namespace, Wire, missing, round_trips_ms
from robotapp_agent.probe.peers import MOST_PEERS
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


DELAYS_MS = {"b": 0.0, "c": 2.0, "d": 15.0, "e": 60.0}
LOSSES = {"b": 0.01, "c": 0.05, "d": 0.2}
ROUND_S = 10.0
ROUNDS_OF_A_MINUTE = 6
SHORT_ROUND_S = 1.0
MOST_CORE_SHARE = 0.005
MOST_HOSTILE_US = 50.0


@dataclass(frozen=True, slots=True)
class Accuracy:
    """One link in one minute with 20 % jitter and 1 % loss: each round's median beside ping's of the same minute."""

    delay_ms: float
    ping_us: float
    p50_us: list[int | None]

    @property
    def good(self) -> bool:
        return all(is_as_ping(each, self.ping_us) for each in self.p50_us)


@dataclass(frozen=True, slots=True)
class Loss:
    share: float
    lost: int
    sent: int

    @property
    def good(self) -> bool:
        return is_likely(self.lost, self.sent, self.share)


@dataclass(frozen=True, slots=True)
class Notice:
    """Rounds until a link that went down was unreachable, and until one that returned was measured."""

    down: list[int]
    up: list[int]

    @property
    def good(self) -> bool:
        return max(self.down) <= 3 and max(self.up) <= 2


@dataclass(frozen=True, slots=True)
class Cost:
    """`core_share`: of an agent that probes `peers` nodes and is probed by as many, by rounds of 10 s."""

    peers: int
    core_share: float


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    reason = missing()
    if reason:
        print(reason, file=sys.stderr)
        return 1
    scale = 5 if arguments.long else 1
    with ProbingNodes(["a", *DELAYS_MS], seed=arguments.seed) as nodes:
        accuracy = [each for _ in range(scale) for each in measure_accuracy(nodes)]
        losses = measure_losses(nodes, rounds=60 * scale)
        notice = measure_notice(nodes, times=5 * scale)
    costs = [measure_cost(peers) for peers in (3, MOST_PEERS)]
    hostile_us = measure_hostile_us()
    report(accuracy, losses, notice, costs, hostile_us)
    if arguments.json:
        found = {
            "accuracy": [asdict(each) for each in accuracy],
            "losses": [asdict(each) for each in losses],
            "notice": asdict(notice),
            "costs": [asdict(each) for each in costs],
            "hostile_us": hostile_us,
        }
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")
    problems = verdict(accuracy, losses, notice, costs, hostile_us)
    print("\n".join(problems) or "all bounds are kept")
    return 1 if problems else 0


def measure_accuracy(nodes: ProbingNodes) -> list[Accuracy]:
    for peer, delay_ms in DELAYS_MS.items():
        nodes.wire.switch.set_link("a", peer, delay_ms=delay_ms, jitter_ms=0.2 * delay_ms, loss=0.01)
    rounds = [nodes.round_beside_ping("a", seconds=ROUND_S) for _ in range(ROUNDS_OF_A_MINUTE)]
    nodes.wire.switch.set_node("a", delay_ms=0, jitter_ms=0, loss=0)
    return [
        Accuracy(
            delay_ms,
            median(ping_us[peer] for _, ping_us in rounds),
            [measured.results[peer].p50_us if peer in measured.results else None for measured, _ in rounds],
        )
        for peer, delay_ms in DELAYS_MS.items()
    ]


def measure_losses(nodes: ProbingNodes, *, rounds: int) -> list[Loss]:
    for peer, share in LOSSES.items():
        nodes.wire.switch.set_link("a", peer, loss=share, one_way=True)
    results = [nodes.round("a", seconds=SHORT_ROUND_S).results for _ in range(rounds)]
    nodes.wire.switch.set_node("a", loss=0)
    return [
        Loss(
            share,
            sum(result[peer].sent - result[peer].answered for result in results),
            sum(result[peer].sent for result in results),
        )
        for peer, share in LOSSES.items()
    ]


def measure_notice(nodes: ProbingNodes, *, times: int) -> Notice:
    notice = Notice([], [])
    for _ in range(times):
        for rounds, down in ((notice.down, True), (notice.up, False)):
            nodes.wire.switch.set_link("a", "b", down=down)
            rounds.append(_rounds_until(nodes, unreachable=down))
    return notice


def _rounds_until(nodes: ProbingNodes, *, unreachable: bool) -> int:
    for number in range(1, 20):
        result = nodes.round("a", seconds=SHORT_ROUND_S).results.get("b")
        if result and (result.p50_us is None) == unreachable:
            return number
    return 20


def measure_cost(peers: int) -> Cost:
    names = [f"n{index}" for index in range(peers + 1)]
    with ProbingNodes(names) as nodes, ThreadPoolExecutor(len(names)) as pool:
        used_s = [each.cpu_s for each in pool.map(lambda name: nodes.round(name, seconds=ROUND_S), names)]
    return Cost(peers, mean(used_s) / ROUND_S)


def measure_hostile_us() -> float:
    """A forged request, the dearest of all that is refused: its code is computed."""
    end, count = responder(keys=ring()), 10_000
    forged = bytearray(request_of(prober()))
    forged[-1] ^= 1
    began_s = time.process_time()
    for _ in range(count):
        end.answer(bytes(forged), source="10.0.0.66", received_ns=0)
    return (time.process_time() - began_s) / count * 1e6


def report(
    accuracy: Sequence[Accuracy], losses: Sequence[Loss], notice: Notice, costs: Sequence[Cost], hostile_us: float
) -> None:
    print(f"{'one-way delay':>16}{'ping p50 ms':>14}{'agent p50 ms, least … most':>32}")
    for each in accuracy:
        known = [p50_us for p50_us in each.p50_us if p50_us is not None]
        span = f"{min(known) / 1000:.3f} … {max(known) / 1000:.3f}" if known else "unreachable"
        print(f"{each.delay_ms:>13g} ms{each.ping_us / 1000:>14.3f}{span:>32}")
    print(f"\n{'loss set':>16}{'seen':>10}{'probes':>10}")
    for loss in losses:
        print(f"{loss.share:>16.0%}{loss.lost / loss.sent:>10.2%}{loss.sent:>10}")
    print(f"\nrounds until noticed: down {notice.down}, up {notice.up}")
    for cost in costs:
        print(f"{cost.peers} peers in both directions: {cost.core_share:.2%} of a core")
    print(f"a forged datagram: {hostile_us:.1f} us")


def verdict(
    accuracy: Sequence[Accuracy], losses: Sequence[Loss], notice: Notice, costs: Sequence[Cost], hostile_us: float
) -> list[str]:
    """What falls short, in sentences. The cost of 16 peers is for information."""
    return [
        *(
            f"{each.delay_ms:g} ms: {each.p50_us} us are not all near ping's {each.ping_us:.0f}"
            for each in accuracy
            if not each.good
        ),
        *(f"{each.share:.0%} loss: {each.lost} of {each.sent} is unlikely" for each in losses if not each.good),
        *([] if notice.good else [f"noticed too late: {notice}"]),
        *(
            f"{each.peers} peers cost {each.core_share:.2%} of a core, more than {MOST_CORE_SHARE:.1%}"
            for each in costs
            if each.core_share > MOST_CORE_SHARE and each.peers < MOST_PEERS
        ),
        *([f"a forged datagram costs {hostile_us:.0f} us"] if hostile_us > MOST_HOSTILE_US else []),
    ]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench probes", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--long", action="store_true", help="five times as many rounds")
    parser.add_argument("--seed", type=int, default=1, help="of the losses")
    parser.add_argument("--json", type=options.report, help="write the figures to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
