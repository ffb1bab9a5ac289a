"""Does placement by measured latency help a real robot loop? Our scheduler beside kube-scheduler, on real nodes.

Five real nodes behind the latency switch: two robots, an edge server near them, one in another hall, a cloud. Some teleoperation apps
(50 Hz, Cyclone DDS) are placed by one scheduler, run, and tell their round trips; then the same by the other, and in the next round in the
other order. Operator, scheduler and node agents run as pods; what they use comes from the kubelets. Needs root. `--long` adds ten minutes of three
apps with cameras.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from campaigns.common import options
from campaigns.common.output import save, say
from campaigns.nodes import stability
from campaigns.nodes import teleop_app as teleop
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import cloud, edge, robot
from robotapp_testbed.real import RealNodes, UnavailableError, prerequisites
from ros_nodes.trips import TRIP, Row, percentile, summarise

REAL = (
    "real: kubelets, containers and network namespaces; Cyclone DDS in every pod; round trips as the operator's program measures them;"
    " our operator, scheduler and node agents as pods of the chart; kube-scheduler as it is"
)
SIMULATED = (
    "simulated: distances (a switch in user space holds each frame back, one way, as set per pair of nodes); the robot and its operator"
    " (programs that answer at once). All nodes and both schedulers share the CPUs of this machine: absolute times are its own, the"
    " comparison is what counts"
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of all apps of one scheduler together, in one run."""

    scheduler: str
    nodes: dict[str, str]
    """Where each app's operator side went."""
    sent: int
    missed: int
    p50_us: int | None
    p95_us: int | None
    p99_us: int | None

    @property
    def missed_share(self) -> float:
        return self.missed / self.sent if self.sent else 1.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Over the runs that have the figure; None when none has."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float | None]) -> "Spread | None":
        known = [each for each in values if each is not None]
        return cls(statistics.median(known), min(known), max(known)) if known else None


def order(schedulers: tuple[str, str], rounds: int) -> list[str]:
    """A B, B A, A B …: what changes on the machine meanwhile meets both alike."""
    one, other = schedulers
    return [name for turn in range(rounds) for name in ((one, other), (other, one))[turn % 2]]


def outcome(
    scheduler: str, told: Mapping[str, tuple[str, Sequence[Row]]], *, deadline_us: int, settle_us: int
) -> Outcome:
    """`told` has the node of its operator side and the rows of every app."""
    summaries = [summarise(rows, deadline_us=deadline_us, settle_us=settle_us) for _, rows in told.values()]
    rtts = sorted(
        row.rtt_us
        for _, rows in told.values()
        for row in rows
        if row.kind == TRIP and row.rtt_us is not None and row.at_us >= settle_us
    )
    return Outcome(
        scheduler=scheduler,
        nodes={name: node for name, (node, _) in told.items()},
        sent=sum(each.sent for each in summaries),
        missed=sum(each.missed for each in summaries),
        p50_us=percentile(rtts, 50),
        p95_us=percentile(rtts, 95),
        p99_us=percentile(rtts, 99),
    )


def spreads(outcomes: Sequence[Outcome]) -> dict[str, dict[str, Spread | None]]:
    """By scheduler and figure, times in µs, `missed` a share."""
    found = {}
    for scheduler in dict.fromkeys(each.scheduler for each in outcomes):
        runs = [each for each in outcomes if each.scheduler == scheduler]
        found[scheduler] = {
            "p50_us": Spread.of([each.p50_us for each in runs]),
            "p95_us": Spread.of([each.p95_us for each in runs]),
            "p99_us": Spread.of([each.p99_us for each in runs]),
            "missed": Spread.of([each.missed_share for each in runs]),
        }
    return found


def line(each: Outcome) -> str:
    """One run."""
    times = ", ".join(
        f"{name} {value / 1000:.1f} ms" if value is not None else f"{name} none"
        for name, value in (("p50", each.p50_us), ("p95", each.p95_us), ("p99", each.p99_us))
    )
    return (
        f"{each.scheduler}: {times}, missed {each.missed_share:.1%}; operator sides on {', '.join(each.nodes.values())}"
    )


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Medians over the runs, least and most in brackets."""
    lines = [f"{'medians (least to most)':25}{'runs':>5}{'p50 ms':>20}{'p95 ms':>20}{'p99 ms':>20}{'missed':>26}"]
    for scheduler, figures in spreads(outcomes).items():
        runs = sum(each.scheduler == scheduler for each in outcomes)
        times = "".join(f"{_ms(figures[name]):>20}" for name in ("p50_us", "p95_us", "p99_us"))
        lines.append(f"{scheduler:25}{runs:>5}{times}{_share(figures['missed']):>26}")
    return lines


def as_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    figures = {
        scheduler: {
            name: (spread.median, spread.least, spread.most) if spread else None for name, spread in each.items()
        }
        for scheduler, each in spreads(outcomes).items()
    }
    return {"real": REAL, "simulated": SIMULATED, "median_least_most": figures}


def _ms(spread: Spread | None) -> str:
    if spread is None:
        return "-"
    return f"{spread.median / 1000:.1f} ({spread.least / 1000:.1f}-{spread.most / 1000:.1f})"


def _share(spread: Spread | None) -> str:
    return f"{spread.median:.1%} ({spread.least:.1%}-{spread.most:.1%})" if spread else "-"


NODES = (robot("robot-1"), robot("robot-2"), edge("edge-1"), edge("edge-2", zone="hall-2"), cloud("cloud-1"))
ONE_WAY_MS = {
    ("robot-1", "edge-1"): 2,
    ("robot-1", "edge-2"): 8,
    ("robot-1", "cloud-1"): 30,
    ("robot-1", "robot-2"): 6,
    ("robot-2", "edge-1"): 2,
    ("robot-2", "edge-2"): 8,
    ("robot-2", "cloud-1"): 30,
    ("edge-1", "edge-2"): 6,
    ("edge-1", "cloud-1"): 28,
    ("edge-2", "cloud-1"): 28,
}
SCHEDULERS = ("ros-aware-scheduler", "default-scheduler")
BUDGET_MS = 10
DEADLINE_US = 20_000  # a 50 Hz loop: the answer must be there before the next command
SETTLE_US = 2_000_000
FIRST_TRIP_S = 60.0


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem, file=sys.stderr)
        return 1
    print(f"{REAL}\n{SIMULATED}", file=sys.stderr)
    images = ("tools", "ros2", *components_as_pods.IMAGES)
    outcomes: list[Outcome] = []
    stable: stability.Stable | None = None
    turns = order(SCHEDULERS, arguments.rounds)
    with RealNodes(NODES, delays=ONE_WAY_MS, images=images) as cp:
        components_as_pods.run(cp)
        components_as_pods.wait_measured(cp)
        for number, name in enumerate(turns, start=1):
            outcomes.append(run(cp, name, number=number, apps=arguments.apps, seconds=arguments.seconds))
            say(f"run {number} of {len(turns)}: {line(outcomes[-1])}")
            _save(arguments.json, outcomes, stable)
        if arguments.long:
            stable = stability.run(cp, seconds=stability.MINUTES * 60, say=say)
        usage = {**components_as_pods.usage(cp), **components_as_pods.usage(cp, components_as_pods.AGENTS)}
    print("\n".join(table(outcomes)))
    for name, used in usage.items():
        print(f"{name:40} RSS {used.rss_bytes / 1e6:4.0f} MB, CPU {used.cpu_s:5.1f} s since its start")
    _save(arguments.json, outcomes, stable)
    problems = stable.problems if stable else []
    for problem in problems:
        print(problem)
    return 1 if problems else 0


def run(cp: RealNodes, scheduler: str, *, number: int, apps: int, seconds: float) -> Outcome:
    with created(cp, f"teleop-{number}-{scheduler.partition('-')[0]}") as namespace:
        wanted = [_app(f"app-{each}", scheduler) for each in range(apps)]
        teleop.apply(cp, namespace, wanted)
        names = [app["metadata"]["name"] for app in wanted]
        if silent := teleop.silent(cp, namespace, names, within_s=FIRST_TRIP_S):
            raise SystemExit(f"{scheduler}: no round trip of {', '.join(silent)} after {FIRST_TRIP_S:g} s")
        time.sleep(seconds)
        told = {name: _told(cp, namespace, name) for name in names}
        return outcome(scheduler, told, deadline_us=DEADLINE_US, settle_us=SETTLE_US)


def _save(path: Path | None, outcomes: Sequence[Outcome], stable: stability.Stable | None) -> None:
    runs = [asdict(outcome) for outcome in outcomes]
    save(path, {**as_json(outcomes), "runs": runs, "stable": asdict(stable) if stable else None})


def _app(name: str, scheduler: str) -> dict[str, Any]:
    """The robot's side is on its robot; the operator's may be anywhere else."""
    elsewhere = {"separateFrom": ["robot"]}
    return teleop.app(
        name, budget_ms=BUDGET_MS, nodes={"robot": "robot-1"}, operator=elsewhere, spec={"schedulerName": scheduler}
    )


def _told(cp: RealNodes, namespace: str, name: str) -> tuple[str, list[Row]]:
    return teleop.pods(cp, namespace, name)["operator"]["spec"]["nodeName"], teleop.rows(cp, namespace, name)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench teleop", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--apps", type=options.count(1, 20), default=3, help="pairs placed by each scheduler")
    parser.add_argument("--rounds", type=options.count(1, 100), default=2, help="A B, then B A, then A B …")
    parser.add_argument("--seconds", type=options.amount, default=20, help="each scheduler's apps run for, per round")
    parser.add_argument("--long", action="store_true", help="then three apps with cameras for ten minutes")
    parser.add_argument("--json", type=options.report, help="write every run and the medians to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
