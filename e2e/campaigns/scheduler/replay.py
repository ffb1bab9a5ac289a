"""Measures the console's replay: scripts/bench replay [--nodes 5000] [--placed 50000] [--apps 1000] [--pods 500]

In this process, without an API server, on the cache that `scripts/bench whatif` uses: the latest placements, half of them components of
apps with latency budgets, are judged under the running configuration and under one with two other weights. `answer_ms` is all of
it, the copy of the process, encoding and the end of the copy included. It ends with status 1 where the median is longer than five seconds.
"""

import argparse
import asyncio
from pathlib import Path
from typing import Any

from tests.support.scheduling import make_pod

from campaigns.common.output import save
from campaigns.scheduler.whatif import asked, filled, row
from robotapp_api.model.names import OUR_SCHEDULERS
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.shell.process import memory_tuning

MOST_MS = 5000.0
OTHER_WEIGHTS = {"LoadBalanceScore": 40, "TopologyScore": 1}


def place_others(core: SchedulerCore, nodes: int, count: int) -> None:
    """Places pods without an app, of seven sizes, after those of the apps."""
    for number in range(count):
        core.cluster.apply_pod(
            make_pod(f"single-{number}", node=f"node-{number * 13 % nodes}", cpu=f"{100 + number % 7}m")
        )


def build_question(pods: int) -> dict[str, Any]:
    """Returns the body of the request: two weights are changed in both profiles."""
    score = {"enabled": [{"name": name, "weight": weight} for name, weight in OTHER_WEIGHTS.items()]}
    profiles = [{"schedulerName": name, "plugins": {"score": score}} for name in OUR_SCHEDULERS]
    return {"config": {"apiVersion": API_VERSION, "kind": KIND, "profiles": profiles}, "replay": pods}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=5000)
    parser.add_argument("--placed", type=int, default=50_000, help="running pods, those of the apps included")
    parser.add_argument("--apps", type=int, default=1000)
    parser.add_argument("--pods", type=int, default=500, help="placements that are judged")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--json", type=Path, help="write the row to this file")
    args = parser.parse_args()
    core = filled(args.nodes, args.placed - args.pods // 2, args.apps)
    place_others(core, args.nodes, args.pods // 2)
    core.cluster.rtt.latencies()  # fitted long ago where a scheduler runs
    memory_tuning.filled()  # as in the process that places pods
    question = build_question(args.pods)
    result = row("replay", [asyncio.run(asked(core, question)) for _ in range(args.repetitions)])
    print("  ".join(f"{key} {value}" for key, value in result.items()), flush=True)
    save(args.json, [result])
    if result["replayed"] < args.pods:
        raise SystemExit(f"only {result['replayed']} of {args.pods} placements were judged in time")
    if result["answer_ms"] > MOST_MS:
        raise SystemExit(f"an answer took longer than {MOST_MS:g} ms")


if __name__ == "__main__":
    main()
