"""Live differential: the same pods through kube-scheduler and through ours, one at a time, on the same small clusters.

Each pod is decided by one scheduler, noted, deleted, then created again for the other: both see the same cluster,
because deletions and creations of pods reach a scheduler in order, through one watch. Compared are the feasible nodes,
the weighted score of every plugin, the FailedScheduling text character by character, and that our choice is among
kube-scheduler's best. A difference is tried again, in case a node change was still on its way to one of them.
"""

import argparse
import asyncio
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import aiohttp
import msgspec
import yaml
from tests.bench import load, parity_oracle, parity_reference, parity_shapes, parity_volumes
from tests.bench.parity_oracle import OracleLog, Scores
from tests.bench.parity_profiles import profiles
from tests.bench.parity_topology import ARENA, ENDING
from tests.bench.parity_topology import NAMESPACES as SPACES

from robotapp_api.client.api import ApiClient
from robotapp_api.client.errors import Invalid, NotFound
from robotapp_api.client.login import load as login
from robotapp_api.client.resources import NAMESPACES, NODES, PODS, REPLICASETS, SERVICES
from robotapp_testbed import ControlPlane
from robotapp_testbed.process import Process
from robotapp_testbed.product import install, start_scheduler

OURS = "ours"
TRIES = 3
PER_SCENE = 12
Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one scheduler decided. `node` is empty for an unschedulable pod, whose text is `message`."""

    node: str = ""
    message: str = ""
    scores: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    """Feasible node to plugin to weighted score; without scores when a single node was feasible."""
    best: frozenset[str] = frozenset()

    @property
    def feasible(self) -> frozenset[str]:
        return frozenset(self.scores) or (frozenset({self.node}) if self.node else frozenset())


def differences(theirs: Verdict, ours: Verdict) -> list[str]:
    """Every way in which the two differ; empty when they agree."""
    found = []
    if theirs.message != ours.message:
        found.append(f"text: theirs {theirs.message!r}, ours {ours.message!r}")
    if theirs.feasible != ours.feasible:
        found.append(f"feasible: theirs {sorted(theirs.feasible)}, ours {sorted(ours.feasible)}")
    elif len(theirs.feasible) > 1:
        for node in sorted(theirs.feasible):
            names = sorted({*theirs.scores[node], *ours.scores[node]})
            unequal = [
                f"{name} {theirs.scores[node].get(name, 0)}/{ours.scores[node].get(name, 0)}"
                for name in names
                if theirs.scores[node].get(name, 0) != ours.scores[node].get(name, 0)
            ]
            if unequal:
                found.append(f"scores of {node} (theirs/ours): {', '.join(unequal)}")
        if ours.node not in theirs.best:
            found.append(f"choice: ours {ours.node}, their best {sorted(theirs.best)}")
    return found


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench parity", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, help="300, with --reference 20000")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write every case and difference to this file")
    parser.add_argument(
        "--reference", action="store_true", help="against the scalar reference instead, without a cluster"
    )
    parser.add_argument("--case", type=int, metavar="N", help="with --reference: show this one case of the seed")
    arguments = parser.parse_args(argv)
    if arguments.reference:
        return _against_reference(arguments)
    return _against_oracle(arguments)


def _against_reference(arguments: argparse.Namespace) -> int:
    seed = str(arguments.seed)
    if arguments.case is not None:
        print(parity_reference.one(seed=seed, number=arguments.case))
        return 0
    report = parity_reference.campaign(cases=arguments.cases or 20_000, seed=seed, say=_say)
    if arguments.json:
        arguments.json.write_text(json.dumps(report.as_json(), indent=2) + "\n")
    print(report.table())
    for each in report.found[:20]:
        print(json.dumps(each))
    if report.smallest:
        print(f"the first of them, made small:\n{report.smallest}")
    total = report.counts.total()
    print(f"{total} cases, seed {seed}: {len(report.found)} differences, {report.seconds:.0f} s")
    return 1 if report.found else 0


def _against_oracle(arguments: argparse.Namespace) -> int:
    with ControlPlane(kwok=False, controller_manager=False) as cp:
        install(cp)
        report = asyncio.run(run(cp, cases=arguments.cases or 300, seed=arguments.seed, say=_say))
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n")
    unexplained = report["differences"]
    for each in unexplained[:20]:
        print(json.dumps(each, indent=2))
    print(
        f"{report['cases']} cases, seed {arguments.seed}: {report['bound']} bound, {report['refused']} refused,"
        f" {len(unexplained)} differences, {report['seconds']:.0f} s"
    )
    return 1 if unexplained else 0


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def our_config(cp: ControlPlane) -> Path:
    path = cp.run_dir / "parity-ours.yaml"
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": False},
        "profiles": profiles(OURS),
    }
    path.write_text(yaml.safe_dump(document))
    return path


async def run(cp: ControlPlane, *, cases: int, seed: int, say: Callable[[str], None]) -> Json:
    """Start both schedulers and compare `cases` pods. The report's `differences` is empty when they agree."""
    oracle = parity_oracle.start(cp)
    ours = await asyncio.to_thread(start_scheduler, cp, config=our_config(cp), insecure_explain=True)
    endpoint = await asyncio.to_thread(login, cp.kubeconfig("admin"))
    try:
        async with ApiClient(endpoint, user_agent="robotapp-parity") as client, aiohttp.ClientSession() as http:
            arena = Arena(client, http, oracle, ours)
            return await arena.run(cases, Random(seed), say)
    finally:
        await asyncio.to_thread(ours.stop)
        await asyncio.to_thread(oracle.stop)


class Arena:
    """One control plane with both schedulers running."""

    def __init__(self, client: ApiClient, http: aiohttp.ClientSession, oracle: Process, ours: Process) -> None:
        self._client = client
        self._http = http
        self._log = OracleLog(oracle.log_path)
        self._ours = ours
        self._serial = 0

    async def run(self, cases: int, random: Random, say: Callable[[str], None]) -> Json:
        started = time.monotonic()
        for name, labels in SPACES.items():
            await self._client.create(NAMESPACES, {"metadata": {"name": name, "labels": dict(labels)}})
        await parity_volumes.prepare(self._client)
        counts: Counter[str] = Counter()
        families: Counter[str] = Counter()
        found: list[Json] = []
        while counts["cases"] < cases:
            scene = parity_shapes.scene(random)
            await self._build(scene)
            for _ in range(min(PER_SCENE, cases - counts["cases"])):
                shape = parity_shapes.pod(random, "probe", "")
                verdicts = await self._compare(shape)
                if verdicts is None:
                    counts["invalid"] += 1
                    continue
                theirs, ours = verdicts
                counts["cases"] += 1
                counts["bound" if theirs.node else "refused"] += 1
                families.update(_families(shape))
                if unequal := differences(theirs, ours):
                    found.append({"differences": unequal, "pod": shape, "scene": asdict(scene)})
            await self._clear(scene)
            say(f"{counts['cases']}/{cases} cases, {len(found)} differences")
        seconds = time.monotonic() - started
        return {**counts, "families": dict(families), "differences": found, "seconds": seconds}

    async def _build(self, scene: parity_shapes.Scene) -> None:
        await load.create_nodes(self._client, scene.nodes)
        for owner in scene.owners:
            resource = SERVICES if owner["kind"] == "Service" else REPLICASETS
            await self._client.create(resource, owner, namespace=ARENA)
        await parity_volumes.build(self._client, scene.others)
        for pod in scene.placed:
            meta = pod["metadata"]
            namespace = meta.get("namespace", ARENA)
            await self._client.create(PODS, pod, namespace=namespace)
            if status := pod.get("status"):
                patch = {"status": status}
                await self._client.patch(PODS, meta["name"], patch, namespace=namespace, subresource="status")
            if ENDING in meta.get("annotations", {}):
                await self._delete(meta["name"], namespace, grace_s=3600)

    async def _clear(self, scene: parity_shapes.Scene) -> None:
        await parity_volumes.clear(self._client, scene.others)
        for namespace in SPACES:
            await load.delete_pods(self._client, namespace)
        for resource in (SERVICES, REPLICASETS):
            for owner in (await self._client.list(resource, namespace=ARENA)).items:
                await self._client.delete(resource, owner["metadata"]["name"], namespace=ARENA)
        for node in (await self._client.list(NODES)).items:
            await self._client.delete(NODES, node["metadata"]["name"])

    async def _compare(self, shape: Json) -> tuple[Verdict, Verdict] | None:
        """Both verdicts; None when the API server itself refuses the pod."""
        for attempt in range(TRIES):
            await asyncio.sleep(0.2 * attempt)
            try:
                theirs = await self._theirs(shape)
                ours = await self._of_ours(shape)
            except Invalid:
                return None
            if not differences(theirs, ours):
                break
        return theirs, ours

    async def _theirs(self, shape: Json) -> Verdict:
        name, node, message = await self._decide(shape, parity_oracle.SCHEDULER_NAME)
        scores = self._log.read().get(f"{ARENA}/{name}", Scores())
        return Verdict(node, message, scores.plugins, frozenset(scores.best))

    async def _of_ours(self, shape: Json) -> Verdict:
        name, node, message = await self._decide(shape, OURS)
        return Verdict(node, message, await self._explained(name))

    async def _decide(self, shape: Json, scheduler: str) -> tuple[str, str, str]:
        """Create the pod, wait for the decision, delete it: its name, its node, or the text why not."""
        self._serial += 1
        name = f"probe-{self._serial}"
        storage = parity_volumes.Storage(self._client, shape, ARENA, f"-s{self._serial}")
        spec = {**storage.spec(shape["spec"]), "schedulerName": scheduler + shape.get("profile", "")}
        pod = {"metadata": {**shape["metadata"], "name": name}, "spec": spec}
        try:
            await storage.create()
            await self._client.create(PODS, pod, namespace=ARENA)
            async with asyncio.timeout(30):
                while True:
                    decided = await self._look(name, scheduler, binds=parity_volumes.KEY in shape)
                    if decided is not None:
                        return name, decided[0], storage.plain(decided[1])
                    await asyncio.sleep(0.01)
        except TimeoutError:
            return name, "", f"no decision of {scheduler} within 30 s"
        finally:
            await self._delete(name, ARENA)
            await storage.delete()

    async def _look(self, name: str, scheduler: str, *, binds: bool) -> tuple[str, str] | None:
        """(node, "") or ("", text) once it is decided. A pod whose volumes are to be `bound` first has a node in mind."""
        found = await self._client.get(PODS, name, namespace=ARENA)
        if node := found["spec"].get("nodeName"):
            return node, ""
        for condition in found["status"].get("conditions", ()):
            if condition["type"] == "PodScheduled" and condition["status"] == "False":
                return "", condition["message"]
        if not binds:
            return None
        if node := found["status"].get("nominatedNodeName"):
            return node, ""
        if scheduler == OURS and (record := await self._record(name)) is not None and record.get("node"):
            return record["node"], ""
        return None

    async def _delete(self, name: str, namespace: str, *, grace_s: int = 0) -> None:
        body = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", "gracePeriodSeconds": grace_s})
        try:
            await self._client.request("DELETE", PODS.path(namespace, name), body, "application/json")
        except NotFound:
            return

    async def _explained(self, name: str) -> dict[str, dict[str, int]]:
        """Feasible node to plugin to weighted score, as our explain endpoint tells it."""
        record = await self._record(name)
        return weighted(record["top"]) if record is not None and record.get("top") else {}

    async def _record(self, name: str) -> Json | None:
        async with self._http.get(f"{self._ours.health_url}/explain/{ARENA}/{name}", ssl=False) as response:
            if response.status != 200:
                return None
            found: Json = msgspec.json.decode(await response.read())
            return found


def weighted(top: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    """Node to plugin to weighted score, from the columns of an explain record."""
    return {
        node: {name: top["weights"][name] * scores[at] for name, scores in top["scores"].items()}
        for at, node in enumerate(top["nodes"])
    }


def _families(shape: Json) -> list[str]:
    names = ("nodeSelector", "affinity", "tolerations", "initContainers", "resources", "volumes")
    return [key for key in names if key in shape["spec"]] + [f"profile{end}" for end in [shape.get("profile")] if end]


if __name__ == "__main__":
    sys.exit(main())
