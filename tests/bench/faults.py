"""Our scheduler on a live control plane that is hurt while thousands of pods wait: nothing doubled, lost or overfull.

Every run begins and ends with an empty namespace and fresh scheduler processes. Checked at every watch event: a pod is
bound once and stays, no node holds more than it has. At rest: every pod is bound or told why, the scheduler's queues and
cache say the same as the API server, and it does nothing any more. `--room short` leaves 1 % of the pods without a place.
"""

import argparse
import asyncio
import json
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.bench.figures import table
from tests.support.scheduler_faults.campaign import Campaign
from tests.support.scheduler_faults.faults import FAULTS, clock_environment
from tests.support.scheduler_faults.run import Plan

from robotapp_testbed import ControlPlane

ROOM = {"enough": 1.1, "short": 0.99}


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    names = arguments.fault or list(FAULTS)
    rooms = list(ROOM) if arguments.room == "both" else [arguments.room]
    with ControlPlane(kwok=False, controller_manager=False, audit=True) as cp:
        results = asyncio.run(_all(cp, arguments, [(name, room) for name in names for room in rooms]))
    print(table({f"{each['fault']}, {each['room']}": _figures(each) for each in results}))
    for each in results:
        for problem in each["problems"]:
            print(f"{each['fault']}, room for {each['room']}: {problem}")
    if arguments.json:
        machine = {"python": platform.python_version(), "machine": platform.machine()}
        arguments.json.write_text(json.dumps({"machine": machine, "runs": results}, indent=1) + "\n")
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


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def _figures(found: dict[str, Any]) -> dict[str, float]:
    figures = {name: value for name, value in found.items() if isinstance(value, int | float) and name != "seed"}
    return figures | {"problems": len(found["problems"])}


if __name__ == "__main__":
    sys.exit(main())
