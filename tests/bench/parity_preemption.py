"""Live differential of preemption: the same full clusters for kube-scheduler and for ours, built anew for each.

Compared are the message character by character, the victims that are really gone, and the node. Where two nodes cost the
same kube-scheduler takes any, so another node at the same cost is no difference.
"""

import argparse
import asyncio
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from tests.bench import load, parity_oracle, preemption_shapes
from tests.bench.parity import OURS, our_config
from tests.bench.preemption_shapes import CLASSES, Scene, cost

from robotapp_api.client.api import ApiClient
from robotapp_api.client.errors import AlreadyExists
from robotapp_api.client.login import load as login
from robotapp_api.client.resources import NAMESPACES, NODES, PODDISRUPTIONBUDGETS, PODS, Resource
from robotapp_testbed import ControlPlane
from robotapp_testbed.product import install, start_scheduler

Json = dict[str, Any]
PRIORITYCLASSES = Resource("scheduling.k8s.io", "v1", "priorityclasses", "PriorityClass", namespaced=False)
SPACE = "arena"
VIP = "vip"
TRIES = 3
PATIENCE_S = 3.0
FOUND = "found a potential placement"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a scene: the first refusal, who is gone, and where the pod ended up."""

    message: str
    victims: tuple[str, ...]
    node: str


def difference(scene: Scene, theirs: Verdict, ours: Verdict) -> str:
    """How the two differ, "" when they agree."""
    both = bool(theirs.victims and ours.victims and theirs.node and ours.node)
    same_text = both and theirs.message.replace(theirs.node, "X") == ours.message.replace(ours.node, "X")
    # Without victims the nodes are compared by scripts/bench parity, score by score.
    same_place = not (theirs.victims or ours.victims) and bool(theirs.node) == bool(ours.node)
    if theirs == ours or (same_place and theirs.message == ours.message):
        return ""
    if same_text and theirs.node != ours.node and cost(scene, theirs.victims) == cost(scene, ours.victims):
        return ""
    return f"theirs {theirs}, ours {ours}"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench parity_preemption", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write counts and differences to this file")
    arguments = parser.parse_args(argv)
    with ControlPlane(kwok=False, controller_manager=False) as cp:
        install(cp)
        report = asyncio.run(run(cp, cases=arguments.cases, seed=arguments.seed, say=_say))
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")
    for each in report["differences"][:10]:
        print(json.dumps(each, indent=2))
    print(
        {key: value for key, value in report.items() if key != "differences"}, len(report["differences"]), "differences"
    )
    return 1 if report["differences"] else 0


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


async def run(cp: ControlPlane, *, cases: int, seed: int, say: Callable[[str], None]) -> Json:
    """Start both schedulers and compare `cases` scenes; counts, and the differences with their scenes."""
    oracle = parity_oracle.start(cp)
    ours = await asyncio.to_thread(start_scheduler, cp, config=our_config(cp))
    endpoint = await asyncio.to_thread(login, cp.kubeconfig("admin"))
    try:
        async with ApiClient(endpoint, user_agent="robotapp-parity") as client:
            return await _Arena(client).run(cases, Random(seed), say)
    finally:
        await asyncio.to_thread(ours.stop)
        await asyncio.to_thread(oracle.stop)


class _Arena:
    """One control plane with both schedulers running."""

    def __init__(self, client: ApiClient) -> None:
        self._client = client

    async def run(self, cases: int, random: Random, say: Callable[[str], None]) -> Json:
        await self._client.create(NAMESPACES, {"metadata": {"name": SPACE}})
        for name, value in CLASSES.items():
            policy = {"preemptionPolicy": "Never"} if name == "p-polite" else {}
            try:
                await self._client.create(PRIORITYCLASSES, {"metadata": {"name": name}, "value": value, **policy})
            except AlreadyExists:
                continue
        counts: Counter[str] = Counter()
        found: list[Json] = []
        for case in range(cases):
            scene = preemption_shapes.scene(random)
            theirs, ours, unequal = await self._compare(scene)
            counts["preempted" if theirs.victims else "bound" if theirs.node else "refused"] += 1
            if unequal:
                found.append({"case": case, "difference": unequal, "scene": repr(scene), "ours": repr(ours)})
            if case % 20 == 19:
                say(f"{case + 1}/{cases} cases, {dict(counts)}, {len(found)} differences")
        return {"cases": cases, **counts, "differences": found}

    async def _compare(self, scene: Scene) -> tuple[Verdict, Verdict, str]:
        """A difference is tried again, in case a budget or node was still on its way to one of them."""
        for attempt in range(TRIES):
            pause_s = 0.1 + 0.5 * attempt
            theirs = await self._verdict(scene, parity_oracle.SCHEDULER_NAME, pause_s)
            ours = await self._verdict(scene, OURS, pause_s)
            unequal = difference(scene, theirs, ours)
            if not unequal:
                break
        return theirs, ours, unequal

    async def _verdict(self, scene: Scene, scheduler: str, pause_s: float) -> Verdict:
        await self._build(scene)
        await asyncio.sleep(pause_s)
        try:
            pod = {**scene.pod, "metadata": {**scene.pod["metadata"], "name": VIP}}
            pod["spec"] = {**pod["spec"], "schedulerName": scheduler}
            await self._client.create(PODS, pod, namespace=SPACE)
            message, node = await self._decided(scheduler)
            left = {pod["metadata"]["name"] for pod in (await self._client.list(PODS, namespace=SPACE)).items}
            return Verdict(message, tuple(p.name for p in scene.placed if p.name not in left), node)
        finally:
            await self._clear()

    async def _decided(self, scheduler: str) -> tuple[str, str]:
        """The first refusal and, when a place was made or found, the node.

        kube-scheduler may leave a preemptor waiting after its victims are gone: refused for a host port, it is woken only
        by victims that used one, and not while its evictions run. Then the node it announced counts.
        """
        message = ""
        announced_s = float("inf")
        deadline_s = time.monotonic() + 30
        while time.monotonic() < deadline_s:
            found = await self._client.get(PODS, VIP, namespace=SPACE)
            conditions = found["status"].get("conditions", ())
            said = [
                each["message"] for each in conditions if (each["type"], each["status"]) == ("PodScheduled", "False")
            ]
            message = message or (said[0] if said else "")
            if node := found["spec"].get("nodeName"):
                return message or await self._told(scheduler), node
            if message and FOUND not in message:
                return message, ""
            if message and announced_s == float("inf"):
                announced_s = time.monotonic()
            if scheduler != OURS and time.monotonic() > announced_s + PATIENCE_S:
                return message, message.partition("pod on node ")[2].partition(",")[0]
            await asyncio.sleep(0.005)
        return f"no decision of {scheduler} within 30 s", ""

    async def _told(self, scheduler: str) -> str:
        """The condition may be gone before it is read; the event stays."""
        path = f"/apis/events.k8s.io/v1/namespaces/{SPACE}/events"
        deadline_s = time.monotonic() + 1.0
        while time.monotonic() < deadline_s:
            answer = json.loads((await self._client.request("GET", path)).body)
            mine = [e for e in answer["items"] if e.get("reportingController") == scheduler]
            refused = [e["note"] for e in mine if e["reason"] == "FailedScheduling"]
            if refused or any(e["reason"] == "Scheduled" for e in mine):
                return str(refused[0]) if refused else ""
            await asyncio.sleep(0.02)
        return ""

    async def _build(self, scene: Scene) -> None:
        await load.create_nodes(self._client, scene.node_bodies())
        for app, allowed in scene.budgets:
            body = {"metadata": {"name": app}, "spec": {"maxUnavailable": 1, "selector": {"matchLabels": {"app": app}}}}
            await self._client.create(PODDISRUPTIONBUDGETS, body, namespace=SPACE)
            await self._client.patch(
                PODDISRUPTIONBUDGETS,
                app,
                {
                    "status": {
                        "disruptionsAllowed": allowed,
                        "currentHealthy": 0,
                        "desiredHealthy": 0,
                        "expectedPods": 0,
                    }
                },
                namespace=SPACE,
                subresource="status",
            )
        for pod in scene.placed:
            await self._client.create(PODS, pod.body(), namespace=SPACE)
            await self._client.patch(PODS, pod.name, {"status": pod.status()}, namespace=SPACE, subresource="status")

    async def _clear(self) -> None:
        await load.delete_pods(self._client, SPACE)
        for budget in (await self._client.list(PODDISRUPTIONBUDGETS, namespace=SPACE)).items:
            await self._client.delete(PODDISRUPTIONBUDGETS, budget["metadata"]["name"], namespace=SPACE)
        await self._client.request("DELETE", f"/apis/events.k8s.io/v1/namespaces/{SPACE}/events")
        for node in (await self._client.list(NODES)).items:
            await self._client.delete(NODES, node["metadata"]["name"])


if __name__ == "__main__":
    sys.exit(main())
