"""Apply to Ready: one app, between bad ones, 200 at once beside their Deployments applied by hand, more apps than domains, 50 robots; memory.

Ready is what the watch shows: condition Ready=True with the observedGeneration of the stored object. Seconds run from
the API create call. All phases share one control plane with simulated kubelets; sweep and quarantine are one second.
"""

import argparse
import json
import platform
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml
from tests.support.wrong_input.malformed import malformed_apps
from tests.support.wrong_input.malformed_annotations import malformed_annotations, pod

from campaigns.common import process_use
from campaigns.common.output import save, say
from campaigns.rigs import journeys, quiet
from campaigns.rigs.simulated_site import SimulatedSite, plain_app
from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.names import Condition
from robotapp_api.schema.crd import schema_of
from robotapp_claims.protocol.sweeper import PERIOD_S
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.identity import OPERATOR_ACCOUNT
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.topology import fleet

Object = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Misfit:
    """`kind` turns False with a message that contains `field` and every one of `words`."""

    app: Object
    field: str
    words: tuple[str, ...]
    kind: Condition = Condition.ACCEPTED


def misfits() -> list[Misfit]:
    edge = {"topic": "/odom", "from": "sense", "to": "act"}
    nowhere = {"matchLabels": {"robotics.io/robot": "nobody"}}
    return [
        Misfit(plain_app("misspelt", ros={"distro": "humbel"}), "spec.ros.distro", ("humbel", "humble")),
        Misfit(plain_app("ros2-in-ros1", ros={"distro": "noetic"}, ros2={}), "spec.ros2", ("noetic",)),
        Misfit(plain_app("ros1-in-ros2", ros={"distro": "jazzy"}, ros1={}), "spec.ros1", ("jazzy",)),
        Misfit(_torn(), "spec.components[2].separateFrom", ("act", "sense", "colocateWith", "remove")),
        Misfit(plain_app("robotless", robots={"nodeSelector": nowhere}), "spec.robots.nodeSelector", ("no robot that admits namespace", "robots that admit namespace")),
        Misfit(plain_app("masterless", placement={"masterNode": "atlantis"}), "spec.placement.masterNode", ("atlantis", "kubectl get nodes")),
        Misfit(
            plain_app("isolated", ros2={"discovery": {"mode": "Localhost"}}, edges=[edge]),
            "spec.ros2.discovery.mode",
            ("Localhost", "Auto"),
        ),
        Misfit(_with_file("file-ros1", ros={"distro": "noetic"}), "spec.components[0].parameters", ("rosparam",)),
        Misfit(_with_file("file-bare"), "spec.components[0].parameters", ("command or args",)),
        Misfit(
            plain_app("poolless", ros2={"pool": "atlantis"}),
            "spec.ros2.pool",
            ("atlantis", "kubectl get domainpools"),
            Condition.ALLOCATED,
        ),
    ]  # fmt: skip


def _torn() -> Object:
    """Sense with plan, plan with act, yet act apart from sense: only the chain shows it."""
    app = plain_app("torn")
    sense, plan, act = app["spec"]["components"]
    sense["colocateWith"], plan["colocateWith"], act["separateFrom"] = ["plan"], ["act"], ["sense"]
    return app


def _with_file(name: str, **spec: Any) -> Object:
    app = plain_app(name, **spec)
    app["spec"]["components"][0]["parameters"] = [{"configMapKeyRef": {"name": "drv", "key": "params.yaml"}}]
    return app


ROOT = Path(__file__).resolve().parents[3]
IDS = "1-101,215-232"
POOL_SIZE = 119
WITHIN_S = 300
POOLS = {"bench-a": IDS, "bench-b": IDS}
ROBOTS = 50
TELEOP_TARGET_S = 1.5
BETWEEN_TARGET_S = 2.0
MALFORMED, BATCH = 90, 15
RSS_LIMIT_BYTES = 300_000_000
COMPONENTS = 3
FAST_DDS, CYCLONE_DDS = "rmw_fastrtps_cpp", "rmw_cyclonedds_cpp"
TIMES_BY_HAND = 1.5
"""Apps may take so many times as long as their Deployments applied by hand."""
QUIET_LIMIT = 1.0
"""Writes per app and minute while nothing changes."""

Figures = dict[str, Any]
Phase = Callable[[SimulatedSite, argparse.Namespace], tuple[Figures, list[str]]]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench apply", description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write every figure to this file")
    parser.add_argument("--runs", type=int, default=20, help="runs of the single app")
    parser.add_argument("--apps", type=int, default=200, help="apps of the storm, three components each")
    parser.add_argument(
        "--rounds", type=int, default=3, help="times of the apps and of their Deployments by hand, in turn"
    )
    parser.add_argument("--overflow", type=int, default=130, help=f"apps on one pool of {POOL_SIZE} ids")
    parser.add_argument("--quiet-seconds", type=float, default=60.0)
    parser.add_argument(
        "--only",
        choices=sorted({*PHASES, *BESIDE_DEPLOYMENTS}),
        action="append",
        help="this phase only (may be repeated)",
    )
    options = parser.parse_args(argv)
    with ControlPlane(audit=True) as cp:
        product.install(cp, values={"domainPool": {"quarantineSeconds": 1}})
        result = run(cp, options)
    print(json.dumps(result, indent=2))
    save(options.json, result)
    return 1 if result["problems"] else 0


def run(cp: ControlPlane, options: argparse.Namespace) -> Figures:
    """Every phase in turn, then what the operator used for all of them."""
    result: Figures = {"machine": {"python": platform.python_version(), "machine": platform.machine()}}
    problems: list[str] = []
    for sweep_s, phases in ((1.0, PHASES), (PERIOD_S, BESIDE_DEPLOYMENTS)):
        wanted = {name: phase for name, phase in phases.items() if not options.only or name in options.only}
        if not wanted:
            continue
        flags = {"sweep_seconds": sweep_s}
        with SimulatedSite(cp, _nodes(), pools=POOLS, operator_flags=flags, scheduler_flags=flags) as site:
            for name, phase in wanted.items():
                say(name)
                figures, found = phase(site, options)
                problems += [f"{name}: {each}" for each in found]
                result[name] = figures
                say(f"  {figures}{'; '.join(['', *found])}")
            used = {part: process_use.usage(getattr(site, part)) for part in ("operator", "scheduler")}
        result[f"sweep every {sweep_s:g} s"] = used
        if used["operator"]["peak_rss_bytes"] > RSS_LIMIT_BYTES:
            problems.append(f"operator: peak RSS {used['operator']['peak_rss_bytes'] / 1e6:.0f} MB")
    problems += beside_deployments(result)
    return {**result, "problems": problems}


def teleop(site: SimulatedSite, options: argparse.Namespace) -> tuple[Figures, list[str]]:
    """examples/teleop.yaml, one run after the other, each from an empty namespace."""
    app = yaml.safe_load((ROOT / "examples" / "teleop.yaml").read_text())
    seconds = []
    for _ in range(options.runs):
        sent_s = site.create(app)
        seconds.append(site.watch.until_ready("teleop", within_s=30) - sent_s)
        site.clear()
    figures = {"median_s": statistics.median(seconds), "max_s": max(seconds), "runs_s": seconds}
    slow = [f"median {figures['median_s']:.2f} s"] if figures["median_s"] > TELEOP_TARGET_S else []
    return figures, slow


def bad_input(site: SimulatedSite, _: argparse.Namespace) -> tuple[Figures, list[str]]:
    """90 apps the API server refuses in lots of 15, ten that can never work, 59 pods with wrong annotations."""
    cases = malformed_apps(schema_of(RobotApp))
    refused = [cases[index * len(cases) // MALFORMED].obj for index in range(MALFORMED)]
    lots = [refused[first : first + BATCH] for first in range(0, MALFORMED, BATCH)]
    lots.append([case.app for case in misfits()])
    lots.append([pod(f"wrong-{number:02}", wrong) for number, wrong in enumerate(malformed_annotations())])
    found = journeys.between_bad_ones(site, "bench-a", lots)
    site.clear()
    figures = {"median_s": statistics.median(found.between_s), "max_s": max(found.between_s), **asdict(found)}
    slow = [f"a healthy app took {figures['max_s']:.2f} s"] if figures["max_s"] > BETWEEN_TARGET_S else []
    return figures, [*found.problems, *slow]


def storm(site: SimulatedSite, options: argparse.Namespace) -> tuple[Figures, list[str]]:
    """Many apps over two pools, then a quiet minute with all of them running, then the same Deployments applied by hand, and
    both again in turn, each from rest. Each app has two discovery servers, so five Deployments.
    """
    began, before_s = datetime.now(UTC), site.operator.cpu_seconds()
    found = journeys.storm(site, list(POOLS), apps=options.apps, within_s=WITHIN_S, rmw=FAST_DDS)
    operator_s = site.operator.cpu_seconds() - before_s
    asked = quiet.requests_since(site.cp, began, account=OPERATOR_ACCOUNT)
    settled_s = _settle(site)
    records = quiet.writes_during(site.cp, options.quiet_seconds)
    counts = quiet.by_object(records)
    rest = {
        "settled_s": settled_s,
        "seconds": options.quiet_seconds,
        "writes": len(records),
        "writes_per_app_minute": len(records) / options.apps * 60 / options.quiet_seconds,
        "most": counts.most_common(5),
    }
    busy = busy_in_quiet(counts, per_app_minute=rest["writes_per_app_minute"])
    cost = {
        "operator_ms_per_app": operator_s * 1000 / options.apps,
        "operator_requests": dict(asked.most_common()),
    }
    rounds, problems = _in_turn(site, options, found, rmw=FAST_DDS)
    return {**asdict(found), **cost, **rounds, "quiet": rest}, [*problems, *busy]


def peers(site: SimulatedSite, options: argparse.Namespace) -> tuple[Figures, list[str]]:
    """As many apps without discovery servers, so with as many Deployments as components, and these applied by hand."""
    found = journeys.storm(site, list(POOLS), apps=options.apps, within_s=WITHIN_S, rmw=CYCLONE_DDS)
    rounds, problems = _in_turn(site, options, found, rmw=CYCLONE_DDS)
    return {**asdict(found), **rounds}, problems


def _in_turn(
    site: SimulatedSite, options: argparse.Namespace, first: journeys.Storm, *, rmw: str
) -> tuple[Figures, list[str]]:
    """The Deployments of the first storm by hand, then apps and Deployments in turn: the mean seconds of both, and problems."""
    runs, problems = [(first.seconds, _by_hand(site))], list(first.problems)
    for _ in range(1, options.rounds):
        _settle(site)
        found = journeys.storm(site, list(POOLS), apps=options.apps, within_s=WITHIN_S, rmw=rmw)
        problems += found.problems
        runs.append((found.seconds, _by_hand(site)))
    apps_s, by_hand_s = zip(*runs, strict=True)
    return {"seconds": statistics.mean(apps_s), "by_hand_s": statistics.mean(by_hand_s), "runs": runs}, problems


def _by_hand(site: SimulatedSite) -> float:
    """Delete the apps and apply their Deployments alone. Seconds until all are available."""
    made = journeys.as_if_by_hand(site)
    site.clear()
    _settle(site)
    return journeys.by_hand(site, made, within_s=WITHIN_S)


def bare(site: SimulatedSite, options: argparse.Namespace) -> tuple[Figures, list[str]]:
    """As many Deployments as the apps of the storm have components, applied at once without any app."""
    count = options.apps * COMPONENTS
    return {"deployments": count, "seconds": journeys.bare(site, count=count, within_s=WITHIN_S)}, []


def beside_deployments(result: Figures) -> list[str]:
    """Compare apps with the same Deployments applied by hand; what is too slow, in words.

    Besides, with bare Deployments of their components: one container, no discovery servers.
    """
    result["times"] = times = {}
    slow = []
    for name in ("storm", "peers"):
        if name not in result:
            continue
        took_s = result[name]["seconds"]
        beside = {"by_hand": took_s / result[name]["by_hand_s"]}
        if "bare" in result:
            beside["bare"] = took_s / result["bare"]["seconds"]
        times[name] = beside
        if beside["by_hand"] > TIMES_BY_HAND:
            slow.append(f"{name}: apps take {beside['by_hand']:.2f} times as long as their Deployments applied by hand")
    return slow


def busy_in_quiet(counts: Mapping[str, int], *, per_app_minute: float) -> list[str]:
    """What was written although nothing changed: more than a write per app and minute in all, or an object again and again."""
    busy = [f"{count} writes in the quiet minute: {name}" for name, count in counts.items() if count > 1]
    if per_app_minute > QUIET_LIMIT:
        busy.append(f"{per_app_minute:.1f} writes per app in the quiet minute")
    return busy


def overflow(site: SimulatedSite, options: argparse.Namespace) -> tuple[Figures, list[str]]:
    found = journeys.overflow(site, "bench-a", size=POOL_SIZE, apps=options.overflow, within_s=180)
    site.clear()
    return {**asdict(found), "messages": sorted(set(found.messages))}, list(found.problems)


def robots(site: SimulatedSite, _: argparse.Namespace) -> tuple[Figures, list[str]]:
    found = journeys.one_per_robot(site, pool="bench-a", within_s=120)
    site.clear()
    return asdict(found), list(found.problems)


PHASES: Mapping[str, Phase] = {
    "teleop": teleop,
    "bad_input": bad_input,
    "overflow": overflow,
    "robots": robots,
}
BESIDE_DEPLOYMENTS: Mapping[str, Phase] = {"bare": bare, "peers": peers, "storm": storm}


def _nodes() -> Topology:
    """Room for 600 pods of the storm at 110 per node, and the robots."""
    names = ["amr-07", *(f"amr-{number:02}" for number in range(10, 10 + ROBOTS - 1))]
    return fleet(robots=names, edges=4, clouds=2)


def _settle(site: SimulatedSite) -> float:
    """Seconds from now until nothing is written any more for five."""
    began_s = time.monotonic()
    if not quiet.until_quiet(site.cp, quiet_s=5.0, within_s=60):
        say("  operator or scheduler keep writing")
    return time.monotonic() - began_s


if __name__ == "__main__":
    sys.exit(main())
