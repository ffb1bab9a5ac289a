"""Does a robot loop recover when a link degrades? A component that may move is moved once, on real nodes.

A robot and two edge servers behind the latency switch, operator, scheduler and agents as pods. The operator's side of a
teleoperation app (50 Hz, Cyclone DDS) may run on either server. Its link to the robot degrades from 2 to 60 ms one way; counted is
what follows: the eviction, the first round trip of the successor within the budget, and that nothing moves twice. Then the link
recovers, and next time the other one degrades. What is seen late moves late: agents measure every --interval-seconds. Needs root.
"""

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from campaigns.common import options
from campaigns.common.output import save
from campaigns.nodes import teleop_app as teleop
from robotapp_api.model.names import Annotation
from robotapp_testbed import wait_until
from robotapp_testbed.control_plane import components_as_pods
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import edge, robot
from robotapp_testbed.real import RealNodes, UnavailableError, prerequisites
from ros_nodes.trips import TRIP, parse

NODES = (robot("robot-1"), edge("edge-1"), edge("edge-2"))
GOOD_MS, BAD_MS = 2, 60
ONE_WAY_MS = {("robot-1", "edge-1"): GOOD_MS, ("robot-1", "edge-2"): GOOD_MS, ("edge-1", "edge-2"): GOOD_MS}
BUDGET_MS = 20
APP = "loop"
MOST_S = 8.0
"""The issue's bound on the time from the end of `for` to recovery."""
PATIENCE_S = 90.0
QUIET_S = 10.0
"""So long after the recovery nothing else may move."""


@dataclass(frozen=True, slots=True)
class Step:
    """Seconds since the link degraded. `medians_ms`: of the app's round trips before, while degraded and after."""

    before: str
    after: str
    evicted_s: float
    recovered_s: float
    medians_ms: tuple[float, float, float]
    moves: int
    """Recorded for this step: 1 is right."""

    def problems(self, for_s: float) -> list[str]:
        found = [] if self.moves == 1 else [f"{self.moves} moves were recorded instead of one"]
        late_s = self.recovered_s - for_s
        return found + ([f"it recovered {late_s:.1f} s after `for`"] if late_s > MOST_S else [])


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    try:
        prerequisites.require()
    except UnavailableError as problem:
        print(problem, file=sys.stderr)
        return 1
    images = ("tools", "ros2", *components_as_pods.IMAGES)
    steps: list[Step] = []
    with RealNodes(NODES, delays=ONE_WAY_MS, images=images) as cp:
        components_as_pods.run(cp, values={"agent": {"intervalSeconds": arguments.interval_seconds}})
        components_as_pods.wait_measured(cp)
        with created(cp, "moves") as namespace:
            teleop.first_trip_s(cp, namespace, _app(arguments.for_seconds))
            _wait_at_rest(cp, namespace)
            for number in range(1, arguments.steps + 1):
                steps.append(_step(cp, namespace, for_s=arguments.for_seconds))
                print(f"step {number}: {_line(steps[-1], arguments.for_seconds)}", file=sys.stderr, flush=True)
    late = [step.recovered_s - arguments.for_seconds for step in steps]
    print(f"{len(steps)} steps: recovered {statistics.median(late):.1f} s after `for` (most {max(late):.1f} s)")
    save(arguments.json, [asdict(step) for step in steps])
    problems = [f"step {n}: {text}" for n, step in enumerate(steps, 1) for text in step.problems(arguments.for_seconds)]
    print("\n".join(problems))
    return 1 if problems else 0


def _step(cp: RealNodes, namespace: str, *, for_s: float) -> Step:
    """Degrade the link in use, and wait until the app's own round trips are within the budget again."""
    old = teleop.pods(cp, namespace, APP)["operator"]
    here, moved = old["spec"]["nodeName"], _moves(cp, namespace)
    before_ms = _median_ms(cp, namespace)
    cp.switch.set_link("robot-1", here, delay_ms=BAD_MS)
    began_s, began = time.monotonic(), time.time()
    try:
        time.sleep(for_s / 2)
        during_ms = _median_ms(cp, namespace)
        evicted_s = _after(began_s, lambda: not _is_there(cp, namespace, old), "the pod is not evicted")
        _after(began_s, lambda: _well_since(cp, namespace, old) is not None, "the app does not recover")
        recovered_s = (_well_since(cp, namespace, old) or math.inf) - began
        time.sleep(QUIET_S)
    finally:
        cp.switch.set_link("robot-1", here, delay_ms=GOOD_MS)
    new = teleop.pods(cp, namespace, APP)["operator"]
    moves = _moves(cp, namespace) - moved
    medians = (before_ms, during_ms, _median_ms(cp, namespace))
    _wait_at_rest(cp, namespace)
    return Step(here, new["spec"]["nodeName"], evicted_s, recovered_s, medians, moves)


def _wait_at_rest(cp: RealNodes, namespace: str) -> None:
    """Until the app is told to be within its budget and both links are measured as good: images and pods were just started, and
    a busy machine answers probes late.
    """
    began_s = time.monotonic()
    _after(began_s, lambda: _budget_met(cp, namespace), "BudgetMet is not True")
    for node in (found.name for found in NODES[1:]):
        _after(began_s, lambda node=node: _is_measured_good(cp, node), f"the link of {node} is not measured as good")


def _after(began_s: float, look: Any, problem: str) -> float:
    if not wait_until(look, timeout_s=PATIENCE_S, poll_s=0.1):
        raise SystemExit(f"{problem} within {PATIENCE_S:g} s")
    return time.monotonic() - began_s


def _is_there(cp: RealNodes, namespace: str, pod: dict[str, Any]) -> bool:
    """Not being deleted either."""
    items = cp.api.get(f"/api/v1/namespaces/{namespace}/pods")["items"]
    found = [item["metadata"] for item in items if item["metadata"]["uid"] == pod["metadata"]["uid"]]
    return bool(found) and "deletionTimestamp" not in found[0]


def _well_since(cp: RealNodes, namespace: str, old: dict[str, Any]) -> float | None:
    """When another pod printed its first round trip within the budget; None as long as none has.

    Seconds of the machine's clock, as the container runtime wrote them to the line: reading a log takes its time as well.
    """
    pod = teleop.pods(cp, namespace, APP).get("operator")
    if pod is None or pod["metadata"]["uid"] == old["metadata"]["uid"]:
        return None
    log = cp.kubectl("logs", "--timestamps", "-n", namespace, pod["metadata"]["name"], check=False)
    for stamp, _, line in (each.partition(" ") for each in log.splitlines()):
        if any(row.kind == TRIP and (row.rtt_us or 0) <= BUDGET_MS * 1000 for row in parse([line])):
            return datetime.fromisoformat(stamp).timestamp()
    return None


def _median_ms(cp: RealNodes, namespace: str) -> float:
    """Of the last two seconds."""
    recent = [row.rtt_us or 0 for row in teleop.trips(cp, namespace, APP)[-100:]]
    return statistics.median(recent) / 1000 if recent else float("inf")


def _moves(cp: RealNodes, namespace: str) -> int:
    items = cp.api.get(f"/apis/apps/v1/namespaces/{namespace}/deployments")["items"]
    texts = [item["metadata"].get("annotations", {}).get(Annotation.MOVES.value) for item in items]
    return sum(len(json.loads(text)["times"]) for text in texts if text)


def _budget_met(cp: RealNodes, namespace: str) -> bool:
    app = cp.api.get(f"/apis/robotics.io/v1alpha1/namespaces/{namespace}/robotapps/{APP}")
    return any(one["type"] == "BudgetMet" and one["status"] == "True" for one in app["status"]["conditions"])


def _is_measured_good(cp: RealNodes, node: str) -> bool:
    """Whether both agents measure the link as good: as long as one does not, nothing can move there."""
    ends = (("robot-1", node), (node, "robot-1"))
    return all(components_as_pods.round_trip(cp, *pair).get("p95Us", BAD_MS * 1000) <= BUDGET_MS * 500 for pair in ends)


def _app(for_s: float) -> dict[str, Any]:
    limits = {"when": "BudgetExceeded", "for": f"{for_s:g}s", "cooldown": "10s", "maxPerDay": 100}
    return teleop.app(
        APP,
        budget_ms=BUDGET_MS,
        nodes={"robot": "robot-1"},
        operator={"runsOn": ["Edge"]},
        spec={"placement": {"reschedule": limits}},
    )


def _line(step: Step, for_s: float) -> str:
    before, during, after = step.medians_ms
    return (
        f"{step.before} to {step.after}, evicted {step.evicted_s - for_s:.1f} s and recovered "
        f"{step.recovered_s - for_s:.1f} s after `for`, {step.moves} move, round trips {before:.0f}, {during:.0f}, {after:.0f} ms"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench moves", description=__doc__)
    parser.add_argument("--steps", type=options.count(1, 100), default=5, help="links that degrade, in turn")
    parser.add_argument("--for-seconds", type=options.count(1, 600), default=5, help="placement.reschedule.for")
    parser.add_argument(
        "--interval-seconds",
        type=options.count(1, 60),
        default=2,
        help="agent.intervalSeconds of the chart (its own choice for three nodes: 10)",
    )
    parser.add_argument("--json", type=options.report, help="write every step to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
