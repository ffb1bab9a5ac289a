"""Robots that vanish and come back under a running fleet: 0 pods restarted, 0 ids changed.

Labels of all robots flap at 1 Hz, nodes are deleted and join again, all labels are taken off at once, and the operator is
restarted under it. Whatever differs afterwards is printed and fails the run.
"""

import argparse
import secrets
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaigns.common.output import save, say
from campaigns.operating.out_of_sight import EVERY_ROBOT, Fleet
from campaigns.rigs.live import Tenant, part
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.machines import topology

MASS_S = 20.0
"""How long all labels are off, with a restart of the operator in the middle. The grace of the app is a tenth of it."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench sight", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0, help="of flapping")
    parser.add_argument("--seed", type=int, default=secrets.randbelow(2**32))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp, values={"domainPool": {"quarantineSeconds": 1}})
        found = run(cp, arguments)
    save(arguments.json, found)
    return 1 if found["lost"] else 0


def run(cp: ControlPlane, arguments: argparse.Namespace) -> dict[str, Any]:
    """The campaign on an empty control plane."""
    nodes = topology.fleet([f"amr-{number:02}" for number in range(arguments.robots)], 0, 0)
    topology.apply(cp, nodes)
    scheduler = product.start_scheduler(cp, sweep_seconds=1)
    operator = product.start_operator(cp, sweep_seconds=1, no_leader_election=True)
    lost: list[str] = []
    with created(cp, "fleet") as namespace:
        fleet = Fleet(cp, nodes, Tenant(cp, namespace), seed=arguments.seed)
        grace = {"grace": f"{int(MASS_S / 10)}s"}
        driver = part("driver", runsOn=["Robot"])
        fleet.tenant.apply("fleet", driver, robots=EVERY_ROBOT, connectivity=grace)
        fleet.tenant.wait_ready("fleet")
        before = fleet.seen()
        say(f"seed {arguments.seed}: {before!r:.80}")

        def check(what: str) -> None:
            fleet.online("fleet")
            found = before.lost(fleet.seen())
            lost.extend(f"{what}: {item}" for item in found)
            say(
                f"{what}: {len(found)} of {len(before.pods)} pods and {len(before.domains)} ids lost, {fleet.writes} writes"
            )

        fleet.flap(arguments.seconds)
        check(f"labels flapped for {arguments.seconds:.0f} s")
        fleet.rejoin(fleet.chance.sample(fleet.robots, 3), after_s=1)
        check("3 nodes deleted and joined again")
        fleet.labels(fleet.robots, on=False)
        time.sleep(MASS_S / 2)
        operator.stop()
        operator = product.start_operator(cp, name="successor", sweep_seconds=1, no_leader_election=True)
        time.sleep(MASS_S / 2)
        fleet.labels(fleet.robots, on=True)
        check(f"all labels off for {MASS_S:.0f} s and a restart of the operator")
    operator.stop()
    scheduler.stop()
    for item in lost:
        print(item)
    return {"robots": arguments.robots, "seconds": arguments.seconds, "seed": arguments.seed, "lost": lost}


if __name__ == "__main__":
    sys.exit(main())
