"""Crash safety: operator and scheduler killed -9 at every write of a 20-app workload.

`scripts/bench crash --all` runs every point; `--points N --seed S` a sample, as scripts/test --all does with 15.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tests.support.apiobjects import ROS
from tests.support.proxy import FaultProxy, Moment

from campaigns.common.output import save, say
from campaigns.rigs.invariants import claims, violations
from robotapp_api.model.names import API_VERSION
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.nodes import Device
from robotapp_testbed.machines.topology import SimulatedTelemetry, apply, fleet

NAMESPACE = "crash"
COMPONENTS = ("operator", "scheduler")
_READY_S = 180.0
_RESTART_S = 30.0
_APPS = f"/apis/{API_VERSION}/namespaces/{NAMESPACE}/robotapps"


@dataclass(frozen=True, slots=True)
class KillPoint:
    """Where a component dies: its `index`-th write (events and leases not counted), before or after it is applied."""

    component: str
    index: int
    moment: Moment

    def __str__(self) -> str:
        return f"{self.component} {self.moment} write {self.index}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one life showed. `missed` are points behind the last write the component made."""

    points: tuple[KillPoint, ...]
    missed: tuple[KillPoint, ...]
    problems: tuple[str, ...]
    ready_s: float
    gone_s: float


def workload(count: int = 20) -> list[dict[str, Any]]:
    """Apps of three components; every fifth owns a device, every seventh is ROS 1, every ninth one instance per robot."""
    return [_app(number) for number in range(count)]


class CrashCampaign:
    """One control plane, reused for all points; operator and scheduler are restarted when they die."""

    def __init__(self, cp: ControlPlane, *, apps: int = 20) -> None:
        self._cp = cp
        self._proxy = FaultProxy()
        self._apps = workload(apps)
        self._processes: dict[str, Process] = {}
        self._telemetry: SimulatedTelemetry | None = None

    def __enter__(self) -> Self:
        product.install(self._cp, values={"domainPool": {"quarantineSeconds": 1}})
        cans = {
            f"robot-{n}": [Device(id=f"can-can{i}", type="can", interface=f"can{i}") for i in range(2)] for n in (1, 2)
        }
        topology = fleet(robots=2, edges=2, clouds=1, devices=cans)
        apply(self._cp, topology)
        self._telemetry = SimulatedTelemetry(self._cp, topology).start()
        self._cp.api.create("/api/v1/namespaces", {"metadata": {"name": NAMESPACE}})
        self._proxy.__enter__()
        for component in COMPONENTS:
            self._start(component)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self._processes.values():
            process.kill()
        if self._telemetry:
            self._telemetry.stop()
        self._proxy.__exit__(kind, error, trace)

    def reference(self) -> dict[str, int]:
        """A life without a kill: how many writes each component makes."""
        outcome = self.live(())
        if outcome.problems:
            raise AssertionError(f"the workload fails without any kill: {outcome.problems}")
        return {each: len(self._proxy.ledger.writes(component=each)) for each in COMPONENTS}

    def live(self, points: Sequence[KillPoint]) -> Outcome:
        """Apply the workload, let the points strike, wait for Ready, delete everything, wait until nothing is left."""
        self._proxy.ledger.reset()
        self._proxy.forget_hooks()
        struck = {point: self._arm(point) for point in points}
        self._cp.kubectl("-n", NAMESPACE, "apply", "-f", "-", stdin=self._apps)
        problems: list[str] = []
        patience_s = _READY_S + _RESTART_S * len(points)
        ready_s = self._until(lambda: self._watched(problems) and self._all_ready(), patience_s)
        if ready_s < 0:
            problems.append(f"not all Ready after {patience_s:.0f} s: {self._not_ready()}")
        problems += _doubles(self._cp)
        self._cp.kubectl("-n", NAMESPACE, "delete", "robotapps", "--all", "--wait=false")
        gone_s = self._until(lambda: self._watched(problems) and not self._left(), patience_s)
        if gone_s < 0:
            problems.append(f"left {patience_s:.0f} s after deletion: {self._left()}")
        problems += [f"fault proxy: {error!r}" for error in self._proxy.errors]
        missed = tuple(point for point, happened in struck.items() if not happened())
        return Outcome(tuple(points), missed, tuple(dict.fromkeys(problems)), ready_s, gone_s)

    # --- inside -----------------------------------------------------------------------------------------------

    def _start(self, component: str) -> None:
        route = self._proxy.route(component, self._cp.kubeconfig(component))
        start = product.start_operator if component == "operator" else product.start_scheduler
        self._processes[component] = start(self._cp, kubeconfig=route.kubeconfig, sweep_seconds=1)

    def _arm(self, point: KillPoint) -> Callable[[], bool]:
        return self._proxy.kill_at(point.component, point.index, point.moment, self._processes[point.component].kill)

    def _until(self, condition: Callable[[], bool], within_s: float) -> float:
        """Seconds until the condition held, -1 when it did not in time."""
        began_s = time.monotonic()
        held = wait_until(condition, timeout_s=within_s, poll_s=0.1)
        return time.monotonic() - began_s if held else -1.0

    def _watched(self, problems: list[str]) -> bool:
        """On every look: broken rules are noted, a dead process is started again."""
        problems += violations(self._cp, NAMESPACE)
        for process in self._processes.values():
            if not process.running:
                process.start()
        return True

    def _all_ready(self) -> bool:
        return not self._not_ready() and len(self._cp.api.get(_APPS)["items"]) == len(self._apps)

    def _not_ready(self) -> list[str]:
        waiting = []
        for app in self._cp.api.get(_APPS)["items"]:
            conditions = {each["type"]: each for each in app.get("status", {}).get("conditions", [])}
            if conditions.get("Ready", {}).get("status") != "True":
                waiting.append(f"{app['metadata']['name']}: {conditions.get('Ready', {}).get('message', '')}")
        return waiting

    def _left(self) -> list[str]:
        """Objects of the workload that still exist."""
        kinds = ("robotapps", "robotappinstances", "deployments", "services", "pods")
        found = self._cp.kubectl("-n", NAMESPACE, "get", ",".join(kinds), "-o", "name").split()
        return found + [claim["metadata"]["name"] for claim in claims(self._cp)]


def _doubles(cp: ControlPlane) -> list[str]:
    """Instances that hold more than one domain at rest."""
    holders = [
        (claim["spec"]["holder"]["uid"], claim["spec"]["holder"].get("instance", ""))
        for claim in claims(cp)
        if claim["spec"].get("domain") and claim.get("status", {}).get("phase") != "Draining"
    ]
    return [
        f"instance {holder} holds {holders.count(holder)} domains"
        for holder in set(holders)
        if holders.count(holder) > 1
    ]


def kill_points(writes: dict[str, int]) -> Iterator[KillPoint]:
    """Every write of every component, before and after."""
    for component in COMPONENTS:
        for index in range(1, writes[component] + 1):
            for moment in Moment:
                yield KillPoint(component, index, moment)


def sample(points: Sequence[KillPoint], count: int, seed: int) -> list[KillPoint]:
    """`count` points spread evenly over the whole list, rotated by the seed so that successive runs cover it all."""
    step = max(1, len(points) // count)
    return [points[(seed + step * n) % len(points)] for n in range(min(count, len(points)))]


def lives(points: Sequence[KillPoint], kills: int) -> list[list[KillPoint]]:
    """Share the points among as few lives as hold `kills` each, so that kills within a life are far apart."""
    count = -(-len(points) // kills)
    ordered = sorted(points, key=lambda point: (point.component, point.index, point.moment))
    return [ordered[start::count] for start in range(count)]


def _app(number: int) -> dict[str, Any]:
    parts: list[dict[str, Any]] = [
        {"name": name, "image": "registry.example/crash:1"} for name in ("sense", "plan", "act")
    ]
    spec: dict[str, Any] = {"ros": ROS, "components": parts}
    if number % 5 == 4:
        device = {"name": "bus", "type": "can", "interface": f"can{number // 5 % 2}"}
        parts[0] |= {"runsOn": ["Robot"], "devices": [device]}
    if number % 7 == 6:
        spec["ros"] = {"distro": "noetic"}
    if number % 9 == 8:
        spec["robots"] = {"nodeSelector": {"matchExpressions": [{"key": "robotics.io/robot", "operator": "Exists"}]}}
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": f"crash-{number:02}"},
        "spec": spec,
    }


LEAST_OF_ALL = 120
"""Kills a whole campaign must have struck to count."""


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    with ControlPlane() as cp, CrashCampaign(cp, apps=arguments.apps) as campaign:
        writes = campaign.reference()
        points = list(kill_points(writes))
        chosen = points if arguments.all else sample(points, arguments.points, arguments.seed)
        planned = lives(chosen, arguments.kills)
        say(f"writes of one life of {arguments.apps} apps: {writes}; {len(chosen)} of {len(points)} kill points")
        outcomes = []
        for number, each in enumerate(planned, 1):
            outcomes.append(campaign.live(each))
            say(f"life {number}/{len(planned)}: {_line(outcomes[-1])}")
    save(arguments.json, {"writes": writes, "outcomes": [asdict(outcome) for outcome in outcomes]})
    failed = sum(bool(each.problems) for each in outcomes)
    struck = _struck(outcomes)
    say(
        f"{struck} kills struck in {len(outcomes)} lives, {len(chosen) - struck} not reached, {failed} lives with problems"
    )
    return exit_code(outcomes, least=LEAST_OF_ALL if arguments.all else 1)


def exit_code(outcomes: Sequence[Outcome], *, least: int) -> int:
    """0 when no life showed a problem and at least `least` kills struck: one that struck nothing has shown nothing."""
    return 1 if any(each.problems for each in outcomes) or _struck(outcomes) < least else 0


def _struck(outcomes: Sequence[Outcome]) -> int:
    return sum(len(each.points) - len(each.missed) for each in outcomes)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench crash", description=__doc__.splitlines()[0])
    amount = parser.add_mutually_exclusive_group()
    amount.add_argument("--all", action="store_true", help="every write, before and after")
    amount.add_argument("--points", type=int, default=15, help="this many, spread over all")
    parser.add_argument("--seed", type=int, default=0, help="rotates the sample")
    parser.add_argument("--kills", type=int, default=12, help="kills within one life of the workload")
    parser.add_argument("--apps", type=int, default=20)
    parser.add_argument("--json", type=Path, help="write every outcome to this file")
    return parser


def _line(outcome: Outcome) -> str:
    verdict = "; ".join(outcome.problems)
    if verdict:
        verdict += f" (kills: {', '.join(map(str, outcome.points))})"
    struck = len(outcome.points) - len(outcome.missed)
    return f"{struck} kills, ready {outcome.ready_s:.1f} s, gone {outcome.gone_s:.1f} s, {verdict or 'ok'}"


if __name__ == "__main__":
    sys.exit(main())
