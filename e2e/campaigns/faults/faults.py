"""Our scheduler on a live control plane that is hurt while thousands of pods wait: nothing doubled, lost or overfull.

Every run begins and ends with an empty namespace and fresh scheduler processes. Checked at every watch event: a pod is
bound once and stays, no node holds more than it has. At rest: every pod is bound or told why, the scheduler's queues and
cache say the same as the API server, and it does nothing any more. `--room short` leaves 1 % of the pods without a place.
"""

import argparse
import asyncio
import math
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from campaigns.common.output import save, say
from campaigns.faults.campaign import Campaign
from campaigns.faults.injected import FAULTS, clock_environment
from campaigns.faults.run import Plan
from campaigns.speed.console import number
from robotapp_testbed import ControlPlane

ROOM = {"enough": 1.1, "short": 0.99}
COLUMNS = ("room", "bound", "reported", "binds", "refused bindings", "seconds", "recovery s", "restarts",
           "peak RSS MB", "CPU ms/pod", "watch gaps")  # fmt: skip
UNTOLD = ("fault", "seed", "pods", "problems", "CPU at rest", "writes at rest", "looks until quiet")
WIDTH = 240


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    names = arguments.fault or list(FAULTS)
    rooms = list(ROOM) if arguments.room == "both" else [arguments.room]
    with ControlPlane(kwok=False, controller_manager=False, audit=True) as cp:
        results = asyncio.run(_all(cp, arguments, [(name, room) for name in names for room in rooms]))
    Console(soft_wrap=True, width=WIDTH).print(_table(results))
    for each in results:
        for problem in each["problems"]:
            print(f"{each['fault']}, room for {each['room']}: {problem}")
    machine = {"python": platform.python_version(), "machine": platform.machine()}
    save(arguments.json, {"machine": machine, "runs": results})
    return 1 if any(each["problems"] for each in results) else 0


async def _all(cp: ControlPlane, arguments: argparse.Namespace, wanted: list[tuple[str, str]]) -> list[dict[str, Any]]:
    results = []
    async with Campaign(cp) as campaign:
        for name, room in wanted:
            say(f"{name}, room {room}: {FAULTS[name].text}")
            found = await campaign.run(plan(cp, name, pods=arguments.pods, seed=arguments.seed, room=ROOM[room]))
            results.append(found)
            say("  " + ", ".join(f"{key} {value}" for key, value in found.items() if key not in ("fault", "problems")))
            for problem in found["problems"]:
                say(f"  PROBLEM {problem}")
    return results


def plan(cp: ControlPlane, name: str, *, pods: int, seed: int, room: float, **changes: Any) -> Plan:
    """The run a fault needs."""
    fault = FAULTS[name]
    return Plan(
        name,
        pods,
        seed,
        room,
        schedulers=fault.schedulers,
        through_proxy=fault.through_proxy,
        environment=clock_environment(fault, cp.run_dir) if fault.clock else {},
        **changes,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench faults", description=__doc__.splitlines()[0])
    parser.add_argument("--pods", type=int, default=10_000)
    parser.add_argument("--fault", action="append", choices=sorted(FAULTS), help="this one only (may be repeated)")
    parser.add_argument("--room", choices=[*ROOM, "both"], default="both", help="nodes for all pods, or for 99 %%")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write every figure to this file")
    return parser


def _table(results: list[dict[str, Any]]) -> Table:
    """One line per run; what only some faults have to tell comes last."""
    made = Table(title="the scheduler under faults")
    for head in ("fault", *COLUMNS, "problems", "more"):
        made.add_column(head, justify="left" if head in {"fault", "more"} else "right", no_wrap=True)
    for each in results:
        more = {name: value for name, value in each.items() if name not in {*COLUMNS, *UNTOLD}}
        cells = [number(each.get(name, math.nan)) for name in COLUMNS]
        told = ", ".join(f"{name} {number(value)}" for name, value in more.items())
        made.add_row(each["fault"], *cells, str(len(each["problems"])), told)
    return made


if __name__ == "__main__":
    sys.exit(main())
