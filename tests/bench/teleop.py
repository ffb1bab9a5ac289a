"""Does placement by measured latency help a real robot loop? Our scheduler beside kube-scheduler, on real nodes.

Five real nodes behind the latency switch: two robots, an edge server near them, one in another hall, a cloud. Some teleoperation apps
(50 Hz, Cyclone DDS) are placed by one scheduler, run, and tell their round trips; then the same by the other. Operator and
scheduler run as pods; what they use comes from the kubelets. Needs root. `--long` adds ten minutes of three apps with cameras.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests.support import teleop

from robotapp_testbed import components_as_pods, wait_until
from robotapp_testbed.namespaces import created
from robotapp_testbed.nodes import cloud, edge, robot
from robotapp_testbed.real import MeasuredTelemetry, RealNodes, UnavailableError, prerequisites
from ros_nodes.trips import TRIP, Row, percentile, summarise

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
STABLE_S = 600.0
STABLE_DEADLINE_US = 100_000


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of all apps of one scheduler together."""

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


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem, file=sys.stderr)
        return 1
    images = ("tools", "ros2", *components_as_pods.IMAGES)
    with RealNodes(NODES, delays=ONE_WAY_MS, images=images) as cp:
        components_as_pods.run(cp)
        with MeasuredTelemetry(cp):
            outcomes = [run(cp, name, apps=arguments.apps, seconds=arguments.seconds) for name in SCHEDULERS]
            problems = steady(cp) if arguments.long else []
        usage = components_as_pods.usage(cp)
    report(outcomes)
    for name, used in usage.items():
        print(
            f"{name.rsplit('-', 2)[0]:20} RSS {used.rss_bytes / 1e6:4.0f} MB, CPU {used.cpu_s:5.1f} s since its start"
        )
    for problem in problems:
        print(problem)
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(each) for each in outcomes], indent=1) + "\n")
    return 1 if problems else 0


def run(cp: RealNodes, scheduler: str, *, apps: int, seconds: float) -> Outcome:
    with created(cp, f"teleop-{scheduler.partition('-')[0]}") as namespace:
        wanted = [_app(f"app-{number}", scheduler) for number in range(apps)]
        teleop.apply(cp, namespace, wanted)
        names = [app["metadata"]["name"] for app in wanted]
        if not wait_until(lambda: not _silent(cp, namespace, names), timeout_s=60, poll_s=0.5):
            raise SystemExit(f"{scheduler}: no round trip of {', '.join(_silent(cp, namespace, names))} after a minute")
        time.sleep(seconds)
        return _outcome(scheduler, {name: _told(cp, namespace, name) for name in names})


def _silent(cp: RealNodes, namespace: str, names: Sequence[str]) -> list[str]:
    return [name for name in names if not teleop.trips(cp, namespace, name)]


def _app(name: str, scheduler: str) -> dict[str, Any]:
    """The robot's side is on its robot; the operator's may be anywhere else."""
    elsewhere = {"separateFrom": ["robot"]}
    return teleop.app(
        name, budget_ms=BUDGET_MS, nodes={"robot": "robot-1"}, operator=elsewhere, spec={"schedulerName": scheduler}
    )


def _told(cp: RealNodes, namespace: str, name: str) -> tuple[str, list[Row]]:
    return teleop.pods(cp, namespace, name)["operator"]["spec"]["nodeName"], teleop.rows(cp, namespace, name)


def _outcome(scheduler: str, told: dict[str, tuple[str, list[Row]]]) -> Outcome:
    summaries = [summarise(rows, deadline_us=DEADLINE_US, settle_us=SETTLE_US) for _, rows in told.values()]
    rtts = sorted(
        row.rtt_us
        for _, rows in told.values()
        for row in rows
        if row.kind == TRIP and row.rtt_us is not None and row.at_us >= SETTLE_US
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


def steady(cp: RealNodes) -> list[str]:
    """Three apps with cameras for ten minutes."""
    with created(cp, "teleop-steady") as namespace:
        teleop.apply(cp, namespace, teleop.trio())
        time.sleep(STABLE_S + 10)
        return teleop.problems_of_trio(cp, namespace, seconds=STABLE_S, deadline_us=STABLE_DEADLINE_US)


def report(outcomes: Sequence[Outcome]) -> None:
    print(f"{'scheduler':22}{'p50 ms':>9}{'p95 ms':>9}{'p99 ms':>9}{'missed':>9}  operator sides on")
    for each in outcomes:
        times = "".join(f"{(value or 0) / 1000:>9.1f}" for value in (each.p50_us, each.p95_us, each.p99_us))
        print(f"{each.scheduler:22}{times}{each.missed_share:>9.1%}  {', '.join(each.nodes.values())}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench teleop", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--apps", type=int, default=3, help="pairs placed by each scheduler")
    parser.add_argument("--seconds", type=float, default=20, help="each scheduler's apps run for")
    parser.add_argument("--long", action="store_true", help="then three apps with cameras for ten minutes")
    parser.add_argument("--json", type=Path, help="write the outcomes to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
