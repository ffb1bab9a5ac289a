"""How long an answer of what-if takes: scripts/bench whatif [--nodes 5000] [--placed 50000] [--apps 1000]

In this process, without an API server: a cache of so many nodes and running pods, among them the apps of three components with two
edges each. `fork_ms` is the copy of the process, `decided_ms` the decision in it, `answer_ms` all of it, encoding and the
end of the copy included, `cpu_ms` the CPU of the copy, which does not depend on what else the machine does. Medians and the worst of
the repetitions. It ends with status 1 where the median of an answer is longer than a second.
"""

import argparse
import asyncio
import json
import os
import statistics
import time
from pathlib import Path
from typing import Any

import msgspec
from tests.support.scheduling import app_object, chain, member_pod

from campaigns.common.output import save
from campaigns.scheduler.cycle import build
from robotapp_api.model.names import API_VERSION
from robotapp_scheduler.config.load import built_in
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.forked_worker import ForkedWorker
from robotapp_scheduler.port.frames import Request
from robotapp_scheduler.port.what_if import WhatIf
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.shell.process import memory_tuning

PARTS = ("sense", "plan", "act")
EDGES = [
    {"topic": f"/{start}", "from": start, "to": end, "latency": {"budget": "30ms"}}
    for start, end in (("sense", "plan"), ("plan", "act"))
]
MOST_MS = 1000.0
CPU = ("children_user", "children_system")


def filled(nodes: int, placed: int, apps: int) -> SchedulerCore:
    """Apps whose parts are on nodes that measured each other, among other pods."""
    core = build(nodes, placed - len(PARTS) * apps)
    opted = {"reschedule": {"when": "BudgetExceeded"}}
    for number in range(apps):
        name, uid = f"app-{number}", f"uid-app-{number}"
        components = [{"name": part} for part in PARTS]
        core.cluster.apply_app(app_object(*components, name=name, uid=uid, edges=EDGES, placement=opted))
        for i, part in enumerate(PARTS):
            for owned in chain(part, app=name, app_uid=uid):
                core.cluster.apply_owner(owned)
            # `build` measures from node n to 7 n + 131 k.
            node = f"node-{number % nodes if i != 1 else number * 7 % nodes}"
            core.cluster.apply_pod(member_pod(part, app=name, app_uid=uid, node=node))
    return core


def questions(apps: int) -> dict[str, dict[str, Any]]:
    """What is asked, by name."""
    middle = apps // 2
    pair = {"one": f"node-{middle}", "other": f"node-{middle * 7}", "rtt": "90ms"}
    tried = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": "tried", "namespace": "default"},
        "spec": {"components": [{"name": part} for part in PARTS], "edges": EDGES},
    }
    config = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    return {
        "node-loss": {"nodeLoss": [f"node-{middle}"]},
        "ten nodes": {"nodeLoss": [f"node-{middle + i}" for i in range(10)]},
        "rtt": {"rtt": [pair]},
        "app": {"apps": [tried]},
        "config": {"config": config},
        "all": {"nodeLoss": [f"node-{middle + 1}"], "rtt": [pair], "apps": [tried], "config": config},
    }


async def asked(core: SchedulerCore, question: dict[str, Any]) -> dict[str, float]:
    """One answer, as the port's request handler gets it."""
    what_if = WhatIf(core, Running(built_in(catalogue())))

    def work(body: bytes) -> bytes:
        status, found = what_if(Request("what-if", with_nodes=True, body=body))
        if status != 200:
            raise SystemExit(found.decode())
        return found

    body = json.dumps(question).encode()
    used_s, began_s = os.times(), time.perf_counter()
    worker = ForkedWorker(work, timeout_s=60.0)
    forked_s = time.perf_counter()
    answer = msgspec.json.decode(await worker.request(body))
    await worker.end()
    ended_s, all_s = time.perf_counter(), os.times()
    return {
        "cpu_ms": 1000 * sum(getattr(all_s, kind) - getattr(used_s, kind) for kind in CPU),
        "fork_ms": 1000 * (forked_s - began_s),
        "decided_ms": answer["decidedMs"],
        "answer_ms": 1000 * (ended_s - began_s),
        "pods": len(answer["pods"]),
        "edges": len(answer["edges"]),
        "replayed": answer["replayed"],
    }


def row(name: str, found: list[dict[str, float]]) -> dict[str, Any]:
    times = {
        f"{key}{suffix}": round(rule([each[key] for each in found]), 1)
        for key in ("fork_ms", "decided_ms", "answer_ms", "cpu_ms")
        for suffix, rule in (("", statistics.median), ("_worst", max))
    }
    return {
        "question": name,
        **times,
        "pods": int(found[0]["pods"]),
        "edges": int(found[0]["edges"]),
        "replayed": int(min(each["replayed"] for each in found)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=5000)
    parser.add_argument("--placed", type=int, default=50_000, help="running pods, those of the apps included")
    parser.add_argument("--apps", type=int, default=1000)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    args = parser.parse_args()
    core = filled(args.nodes, args.placed, args.apps)
    core.cluster.rtt.latencies()  # fitted long ago where a scheduler runs
    memory_tuning.filled()  # as in the process that places pods
    rows = []
    for name, question in questions(args.apps).items():
        rows.append(row(name, [asyncio.run(asked(core, question)) for _ in range(args.repetitions)]))
        print("  ".join(f"{key} {value!s:>9}" for key, value in rows[-1].items()), flush=True)
    save(args.json, rows)
    if any(each["answer_ms"] > MOST_MS for each in rows):
        raise SystemExit(f"an answer took longer than {MOST_MS:g} ms")


if __name__ == "__main__":
    main()
