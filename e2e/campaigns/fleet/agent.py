"""The chart's agent on real nodes for minutes: its memory and CPU as the kubelets count them, against 45 MB and 0.5 % of a core."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from campaigns.common.options import count, report
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.components_as_pods import Usage, agents, usage, wait_measured
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes, UnavailableError, parts, prerequisites

MOST_BYTES: Final = 45_000_000
MOST_PERCENT: Final = 0.5
INTERVAL_S: Final = 10
SETTLING_S: Final = 30.0
EVERY_S: Final = 15.0


@dataclass
class Agent:
    """One node's agent over the whole time."""

    node: str
    first: Usage
    began_s: float
    memory_bytes: int = 0
    rss_bytes: int = 0
    percent: float = 0.0
    series: list[int] = field(default_factory=list)

    def take(self, now_s: float, found: Usage) -> None:
        """Another look at it. Pages of files that may be dropped are part of the working set, not of `rss_bytes`."""
        self.memory_bytes = max(self.memory_bytes, found.memory_bytes)
        self.rss_bytes = max(self.rss_bytes, found.rss_bytes)
        self.percent = 100 * (found.cpu_s - self.first.cpu_s) / max(1.0, now_s - self.began_s)
        self.series.append(found.memory_bytes)

    @property
    def problems(self) -> list[str]:
        wrong = []
        if self.memory_bytes > MOST_BYTES:
            wrong.append(f"{self.node}: {self.memory_bytes / 1e6:.1f} MB, allowed are {MOST_BYTES / 1e6:.0f}")
        if self.percent > MOST_PERCENT:
            wrong.append(f"{self.node}: {self.percent:.2f} % of a core, allowed are {MOST_PERCENT}")
        return wrong

    def __str__(self) -> str:
        return (
            f"{self.node:12} working set ≤ {self.memory_bytes / 1e6:.1f} MB (first {self.series[0] / 1e6:.1f}), "
            f"anonymous ≤ {self.rss_bytes / 1e6:.1f} MB, {self.percent:.3f} % of a core"
        )


def watched(cp: RealNodes, seconds: float) -> list[Agent]:
    """Look at every agent's usage until the time is over."""
    time.sleep(SETTLING_S)
    began_s = time.monotonic()
    namespace = components_as_pods.AGENTS
    found = {pod: Agent(each.node, each, began_s) for pod, each in usage(cp, namespace).items()}
    while time.monotonic() - began_s < seconds:
        time.sleep(min(EVERY_S, seconds))
        for pod, each in usage(cp, namespace).items():
            found[pod].take(time.monotonic(), each)
    return sorted(found.values(), key=lambda agent: agent.node)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench agent", description=__doc__)
    parser.add_argument("--minutes", type=count(1, 600), default=10)
    parser.add_argument("--nodes", type=count(2, 8), default=4)
    parser.add_argument("--json", type=report)
    options = parser.parse_args(arguments)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem)
        return 1
    parts.prepare()
    nodes = [edge("edge-1"), *(robot(f"robot-{number}") for number in range(1, options.nodes))]
    with RealNodes(nodes, delays={}, images=("tools", "agent")) as cp, agents(cp, interval_s=INTERVAL_S):
        wait_measured(cp)
        found = watched(cp, options.minutes * 60)
    for agent in found:
        print(agent, flush=True)
    if options.json:
        figures: list[dict[str, Any]] = [
            {name: getattr(agent, name) for name in ("node", "memory_bytes", "rss_bytes", "percent", "series")}
            for agent in found
        ]
        options.json.write_text(json.dumps({"minutes": options.minutes, "agents": figures}, indent=2))
    wrong = [problem for agent in found for problem in agent.problems]
    print("; ".join(wrong) if wrong else f"{len(found)} agents for {options.minutes} min: within the limits")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
