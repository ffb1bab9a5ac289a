"""etcd goes back to an older snapshot under a running operator and scheduler: double grants, and how long anybody was blind.

A third of the apps exists when the snapshot is taken, and one of these is deleted afterwards: it comes back. Another third gets its ids
afterwards and is lost with them. After the restore the last third asks at once. While the containers of the lost apps may still
run, nobody may get their ids.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from tests.support.apiobjects import ROS

from campaigns.common.options import count, report
from campaigns.common.output import say
from campaigns.rigs.appwatch import condition
from campaigns.rigs.invariants import violations
from campaigns.rigs.live import POOLS, eventually, part
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_api.model.names import API_VERSION, Condition
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.backup import restore_backup, take_backup
from robotapp_testbed.machines import topology

Json = dict[str, Any]
IDS: Final = "1-101,215-232"
POOL_NAMES: Final = ("restore-a", "restore-b")
"""Two networks: one pool has no room for 200 apps."""
QUARANTINE_S: Final = 60
BLIND_LIMIT_S: Final = 60.0
SETTLED_S: Final = 300.0


@dataclass
class Outcome:
    """Figures of a run. seconds: from the moment the API server served again."""

    apps: int
    lost: int
    """Apps that were made after the snapshot, and their grants."""
    new: int
    blind_s: float = 0.0
    """Until the first new app was Ready: operator and scheduler had seen it."""
    ready_s: float = 0.0
    """Until every app that exists was Ready."""
    double: list[str] = field(default_factory=list)
    """Ids of lost apps that somebody else got within the quarantine, and rules that were broken in the API."""
    restarts: Mapping[str, int] = field(default_factory=dict)
    """How often each process said that it starts again."""

    @property
    def failures(self) -> list[str]:
        late = [f"blind for {self.blind_s:.0f} s"] if self.blind_s > BLIND_LIMIT_S else []
        return [*self.double, *late]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench restore", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--apps", type=count(4, 200), default=200, help="old, lost and new ones together")
    parser.add_argument("--json", type=report)
    arguments = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp)
        outcome = run(cp, arguments.apps)
    say(json.dumps(asdict(outcome), indent=1))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(asdict(outcome), indent=1) + "\n")
    for failure in outcome.failures:
        say(f"FAILED: {failure}")
    return 1 if outcome.failures else 0


def run(cp: ControlPlane, apps: int) -> Outcome:
    """Plays the story on a control plane of its own; a third of the apps is old, a third is lost, the rest is new."""
    third = apps // 3
    fleet = topology.fleet()
    with SimulatedSite(cp, fleet, tidy=False) as site:
        for name in POOL_NAMES:
            spec = {"network": name, "ids": IDS, "quarantineSeconds": QUARANTINE_S}
            body = {"apiVersion": API_VERSION, "kind": "DomainPool", "metadata": {"name": name}, "spec": spec}
            cp.api.create(POOLS, body)
        _create(site, "old", third)
        _wait_ready(site, third)
        backup = take_backup(cp)
        _create(site, "lost", third)
        _wait_ready(site, 2 * third)
        holders = {claim["metadata"]["name"]: claim["spec"]["holder"] for claim in site.claims()}
        site.delete("old-0")
        _wait_ready(site, 2 * third - 1)
        lost_grants = {name for name, holder in holders.items() if holder["name"].startswith("lost-")}
        restore_backup(cp, backup)
        outcome = Outcome(apps, lost=third, new=apps - 2 * third)
        _watch_after(site, outcome, lost_grants, old_apps=third)
    return outcome


def _watch_after(site: SimulatedSite, outcome: Outcome, lost_grants: set[str], *, old_apps: int) -> None:
    """Creates the new apps at once and judges what they get."""
    back_s = time.monotonic()
    _create(site, "new", outcome.new)
    eventually(lambda: _ready(site, "new-"), timeout_s=SETTLED_S, what=lambda: _tail(site))
    outcome.blind_s = round(time.monotonic() - back_s, 1)
    _wait_ready(site, old_apps + outcome.new)
    outcome.ready_s = round(time.monotonic() - back_s, 1)
    in_time = time.monotonic() - back_s < QUARANTINE_S
    holders = {claim["metadata"]["name"]: claim["spec"]["holder"]["name"] for claim in site.claims()}
    if in_time:
        outcome.double += [
            f"{name} of a lost app is held by {holders[name]} {outcome.ready_s} s after the restore"
            for name in sorted(lost_grants & holders.keys())
            if not holders[name].startswith("lost-")
        ]
        outcome.double += [f"{name} of a lost app is free" for name in sorted(lost_grants - holders.keys())]
    outcome.double += violations(site.cp, site.namespace)
    outcome.restarts = {
        process.name: process.log_text().count("starts again") for process in (site.operator, site.scheduler)
    }


def _create(site: SimulatedSite, prefix: str, number: int) -> None:
    site.create_all(_app(f"{prefix}-{index}", POOL_NAMES[index % len(POOL_NAMES)]) for index in range(number))


def _app(name: str, pool: str) -> Json:
    spec = {"ros": ROS, "components": [part("main")], "ros2": {"pool": pool}}
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": name}, "spec": spec}


def _ready(site: SimulatedSite, prefix: str = "") -> int:
    apps = site.cp.api.get(site.apps_path)["items"]
    return sum(
        condition(app, Condition.READY).get("status") == "True"
        for app in apps
        if app["metadata"]["name"].startswith(prefix)
    )


def _wait_ready(site: SimulatedSite, number: int) -> None:
    eventually(
        lambda: _ready(site) == number,
        timeout_s=SETTLED_S,
        poll_s=0.5,
        what=lambda: f"{_ready(site)} of {number} ready; {_tail(site)}",
    )


def _tail(site: SimulatedSite) -> str:
    return f"{site.operator.log_tail()}\n{site.scheduler.log_tail()}"


if __name__ == "__main__":
    sys.exit(main())
