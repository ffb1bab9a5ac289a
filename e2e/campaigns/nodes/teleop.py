"""Does placement by measured latency help a real robot loop? Our scheduler beside kube-scheduler, on real nodes.

Five real nodes behind the latency switch: two robots, an edge server near them, one in another hall, a cloud. Some teleoperation apps
(50 Hz, Cyclone DDS) are placed by one scheduler, run, and tell their round trips; then the same by the other, and in the next round in the
other order. Operator, scheduler and node agents run as pods; what they use comes from the kubelets. Needs root. `--long` adds ten minutes of three
apps with cameras.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from campaigns.common import options
from campaigns.nodes import stability
from campaigns.nodes import teleop_app as teleop
from campaigns.nodes.teleop_report import REAL, SIMULATED, Outcome, as_json, line, order, outcome, table
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import cloud, edge, robot
from robotapp_testbed.real import RealNodes, UnavailableError, prerequisites
from ros_nodes.trips import Row

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
    if path:
        found = {
            **as_json(outcomes),
            "runs": [asdict(each) for each in outcomes],
            "stable": asdict(stable) if stable else None,
        }
        path.write_text(json.dumps(found, indent=1) + "\n")


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


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
