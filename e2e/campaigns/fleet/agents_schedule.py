"""What the schedule of thousands of node agents asks of the API server: writes per second by a virtual clock, without any server.

The agents' own rules decide what is a change and when to write and measure; samples, rounds and writes take no time.
`scripts/bench agents` measures the same with real writes, on a machine that has time for them.
"""

import argparse
import heapq
import itertools
import random
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Final

from campaigns.common.options import amount, count, report
from campaigns.common.output import save
from campaigns.fleet.agents import CAMERA, SimulatedNode
from robotapp_agent.process.parts import SAMPLE_S
from robotapp_agent.process.run import START_SPREAD_S, first_write_s
from robotapp_agent.report.changes import ROUND_JITTER, Pace, interval_for, round_s, urgency
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.report.status import Status, status_of

START_INTERVALS: Final = 1.25
"""How much of the run is its start, in which everything is measured for the first time."""

HERD: Final = 1.7


class Clock:
    """Seconds since the start, and what is to happen when."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._order = itertools.count()
        self._queue: list[tuple[float, int, Callable[[], None]]] = []

    def after(self, seconds: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._queue, (self.now_s + seconds, next(self._order), action))

    def run(self, until_s: float) -> None:
        while self._queue and self._queue[0][0] <= until_s:
            self.now_s, _, action = heapq.heappop(self._queue)
            action()


class ScheduledAgent:
    """One agent from its start on: samples, rounds and writes as in `robotapp_agent.process`."""

    def __init__(self, number: int, clock: Clock, written_s: list[float], options: argparse.Namespace) -> None:
        self._clock = clock
        self._written_s = written_s
        self._uniform = random.Random(f"{options.seed}/{number}").random
        self._node = SimulatedNode(number, noise=options.noise, nodes=options.agents, clock=lambda: clock.now_s)
        self._knowledge = Knowledge(arch="arm64", realtime=False, seq=0)
        self._knowledge.devices, self._knowledge.nodes = (CAMERA,), options.agents
        self._pace = Pace(first_s=0.0, uniform=self._uniform)
        self._written: Status | None = None
        self._rounds = 0
        self._looks = 0
        clock.after(START_SPREAD_S * self._uniform(), self._start)

    def _start(self) -> None:
        first_s = self._clock.now_s + first_write_s(self._knowledge.nodes, uniform=self._uniform)
        self._pace = Pace(first_s=first_s, uniform=self._uniform)
        self._sample()
        self._clock.after(self._round_s(), self._round)

    def _sample(self) -> None:
        self._knowledge.sampled(self._node.sample())
        self._look()
        self._clock.after(SAMPLE_S, self._sample)

    def _round(self) -> None:
        lasted_s = self._round_s()
        self._knowledge.round_ended(self._node.round(), every_rounds={})
        self._rounds += 1
        self._look()
        self._clock.after(lasted_s * ROUND_JITTER * self._uniform() + self._round_s(), self._round)

    def _round_s(self) -> float:
        return round_s(ended=self._rounds, interval_s=float(self._knowledge.interval_s), uniform=self._uniform)

    def _look(self) -> None:
        """Write if it is time to, and look again when it will be."""
        status = status_of(self._knowledge.readings())
        if self._pace.due_s(urgency(self._written, status)) <= self._clock.now_s:
            self._pace.wrote(self._clock.now_s, interval_s=float(self._knowledge.interval_s))
            self._written = status
            self._written_s.append(self._clock.now_s)
        self._looks += 1
        look = self._looks
        rest_s = self._pace.due_s(urgency(self._written, status)) - self._clock.now_s
        self._clock.after(max(0.0, rest_s), lambda: self._look() if look == self._looks else None)


def measured(options: argparse.Namespace) -> dict[str, Any]:
    """Writes per second: mean of the time after the start, and the busiest second of start and rest."""
    clock, written_s = Clock(), list[float]()
    for number in range(options.agents):
        ScheduledAgent(number, clock, written_s, options)
    start_s = int(START_SPREAD_S + START_INTERVALS * interval_for(options.agents))
    clock.run(start_s + options.seconds)
    seconds = Counter(int(at_s) for at_s in written_s)
    rest = [seconds[second] for second in range(start_s, start_s + options.seconds)]
    return {
        "agents": options.agents,
        "busiest_second_of_start": max(seconds[second] for second in range(start_s)),
        "writes_per_s": round(sum(rest) / options.seconds, 1),
        "busiest_second": max(rest),
    }


def verdict(found: dict[str, Any], limit: float) -> list[str]:
    """What does not hold. Independent writes at 50 per second are more than HERD times that in one of some hundred seconds about once in 10,000 runs."""
    wrong = [f"{found['writes_per_s']} writes/s, allowed are {limit:g}"] if found["writes_per_s"] > limit else []
    return wrong + [
        f"{found[name]} writes in the {name.replace('_', ' ')}, allowed are {HERD * limit:g}"
        for name in ("busiest_second_of_start", "busiest_second")
        if found[name] > HERD * limit
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench agents_schedule", description=__doc__)
    parser.add_argument("--agents", type=count(1, 20_000), default=5000)
    parser.add_argument("--seconds", type=count(1), default=240, help="after the start; default: 240")
    parser.add_argument(
        "--noise", type=amount, default=0.1, help="standard deviation of load and round trips; default: 0.1"
    )
    parser.add_argument("--limit", type=amount, default=50.0, help="writes per second of all; default: 50")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=report)
    options = parser.parse_args(arguments)
    found = measured(options)
    print("  ".join(f"{name}={value}" for name, value in found.items()))
    save(options.json, found)
    wrong = verdict(found, options.limit)
    print("; ".join(wrong) or "as intended")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
