"""Three teleoperation apps with cameras, two pods each, on four real nodes for as long as one likes: is it stable?"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from campaigns.nodes import teleop_app as teleop
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines.nodes import cloud, edge, robot
from robotapp_testbed.real import RealNodes
from ros_nodes.trips import summarise

MINUTES = 10.0
NODES = (robot("robot-1"), robot("robot-2"), edge("edge-1"), cloud("cloud-1"))
ONE_WAY_MS = {
    ("robot-1", "edge-1"): 2,
    ("robot-2", "edge-1"): 2,
    ("robot-1", "cloud-1"): 15,
    ("robot-2", "cloud-1"): 15,
    ("robot-1", "robot-2"): 6,
    ("edge-1", "cloud-1"): 14,
}
DEADLINE_US = 100_000
_SETTLE_US = 5_000_000
_FIRST_TRIP_S = 60.0
_TOLD_EVERY_S = 60.0


@dataclass(frozen=True, slots=True)
class Stable:
    """What three apps did; `apps` has the figures of each as ros_nodes.trips.Summary does."""

    seconds: float
    deadline_us: int
    apps: dict[str, dict[str, Any]]
    problems: list[str]


def run(cp: RealNodes, *, seconds: float, say: Callable[[str], None]) -> Stable:
    """On a cluster that has robot-1, robot-2, edge-1 and cloud-1, the image ros2, and our operator and scheduler."""
    names = [app["metadata"]["name"] for app in teleop.trio()]
    with created(cp, "teleop-stable") as namespace:
        teleop.apply(cp, namespace, teleop.trio())
        if silent := teleop.silent(cp, namespace, names, within_s=_FIRST_TRIP_S):
            return Stable(0, DEADLINE_US, {}, [f"{name}: no round trip in {_FIRST_TRIP_S:g} s" for name in silent])
        began_s = time.monotonic()
        while (left_s := began_s + seconds - time.monotonic()) > 0:
            time.sleep(min(left_s, _TOLD_EVERY_S))
            say(progress(_summaries(cp, namespace, names), time.monotonic() - began_s, seconds))
        problems = teleop.problems_of_trio(cp, namespace, seconds=seconds, deadline_us=DEADLINE_US)
        return Stable(seconds, DEADLINE_US, _summaries(cp, namespace, names), problems)


def progress(apps: dict[str, dict[str, Any]], passed_s: float, seconds: float) -> str:
    told = "; ".join(
        f"{name} {each['answered']} answers, {each['missed']} late, p99 {(each['p99_us'] or 0) / 1000:.0f} ms"
        for name, each in apps.items()
    )
    return f"stable for {passed_s / 60:.1f} of {seconds / 60:g} min: {told}"


def _summaries(cp: RealNodes, namespace: str, names: list[str]) -> dict[str, dict[str, Any]]:
    return {
        name: asdict(summarise(teleop.rows(cp, namespace, name), deadline_us=DEADLINE_US, settle_us=_SETTLE_US))
        for name in names
    }
