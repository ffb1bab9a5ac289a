"""Ours against kube-scheduler on one live control plane: the same case before both, one after the other.

Each case has a cluster of its own. The pod to place is decided by one scheduler, noted, deleted, then created again for
the other: both see the same cluster, because deletions and creations of pods reach a scheduler in order, through one
watch; after a decision that changed the cluster (victims, volumes) it is built anew. A difference is tried again with
more time, in case an object was still on its way to one of them, and then made small.
"""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import aiohttp
import yaml

from campaigns.cluster_cases import ALL_FAMILIES, Case, seeded_case
from campaigns.cluster_cases.regressions import regressions
from campaigns.cluster_cases.shrinking import reduction
from campaigns.parity import oracle as parity_oracle
from campaigns.parity.oracle import OracleLog
from campaigns.parity.probe import OURS, Pods, Prober, names_claims
from campaigns.parity.profiles import profiles, suffix
from campaigns.parity.report import Report
from campaigns.parity.stage import ADMISSION, Stage
from campaigns.parity.verdict import Verdict, judged, list_failures
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NODETELEMETRIES
from robotapp_client.transport.errors import BadRequest, Forbidden, Invalid, NotFound
from robotapp_client.transport.kubeconfig import load as login
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import install, start_scheduler
from robotapp_testbed.processes.process import Process

Json = dict[str, Any]
LIVE: Final = list(ALL_FAMILIES)
NODES, PLACED = 8, 8
EVERY_ONE_NODE: Final = 4
"""Every so many cases there is one node, whose first reason is the whole text."""
SETTLE_S: Final = (0.03, 0.3, 1.0, 4.0)
"""Waited after a cluster was built, per try: the last is for a machine with much else to do."""
SHRUNK: Final = 3
ATTEMPTS: Final = 120
REFUSALS: Final = (BadRequest, Forbidden, Invalid)
PER_WORD: Final = 50


@dataclass(frozen=True, slots=True)
class Numbered:
    """A case of a campaign. number: within its seed, None for a kept one."""

    case: Case
    profile: str = ""
    number: int | None = None


def campaign(seed: str, cases: int, families: Sequence[str] = LIVE) -> Iterator[Numbered]:
    """What once differed, then `cases` seeded ones."""
    for each in regressions():
        yield Numbered(each.case, each.profile)
    for number in range(cases):
        yield numbered(seed, number, families)


def numbered(seed: str, number: int, families: Sequence[str] = LIVE) -> Numbered:
    nodes = 1 if number % EVERY_ONE_NODE == 0 else NODES
    case = visible(seeded_case(seed, number=number, families=families, nodes=nodes, placed=PLACED))
    return Numbered(case, suffix(seed, number, case.families), number)


def visible(case: Case) -> Case:
    """Without the pod's own promise where volumes have to be bound: nobody could see that it was kept.

    Such a pod gets its node when a volume controller has bound the claims, and there is none; the first sign of the
    choice is the nominated node, which is there already.
    """
    pod = case.objects[-1]
    if not (pod.get("status") or {}).get("nominatedNodeName") or not _binds_volumes(case):
        return case
    status = {key: value for key, value in pod["status"].items() if key != "nominatedNodeName"}
    return replace(case, objects=(*case.objects[:-1], {**pod, "status": status}))


def control_plane() -> ControlPlane:
    return ControlPlane(kwok=False, controller_manager=False, extra_args={"kube-apiserver": [ADMISSION]})


async def run(
    cp: ControlPlane, cases: Iterator[Numbered], *, seed: str, say: Callable[[str], None], shrunk: int = SHRUNK
) -> Report:
    """Install ours, start both schedulers and compare."""
    await asyncio.to_thread(install, cp)
    oracle = await asyncio.to_thread(parity_oracle.start, cp)
    ours = await asyncio.to_thread(start_scheduler, cp, config=our_config(cp), insecure_explain=True)
    endpoint = await asyncio.to_thread(login, cp.kubeconfig("admin"))
    try:
        async with (
            ApiClient(endpoint, user_agent="robotapp-parity") as client,
            aiohttp.ClientSession() as http,
            Pods(client) as pods,
        ):
            await _surround(client)
            return await _Arena(pods, http, oracle, ours, shrunk=shrunk).run(cases, seed, say)
    finally:
        await asyncio.to_thread(ours.stop)
        await asyncio.to_thread(oracle.stop)


def our_config(cp: ControlPlane) -> Path:
    """The default plugins, ROS ones included, with the same arguments as kube-scheduler's."""
    path = cp.run_dir / "parity-ours.yaml"
    document = {
        "apiVersion": "kubescheduler.config.k8s.io/v1",
        "kind": "KubeSchedulerConfiguration",
        "leaderElection": {"leaderElect": False},
        "profiles": profiles(OURS),
    }
    path.write_text(yaml.safe_dump(document))
    return path


async def _surround(client: ApiClient) -> None:
    """RTTs between all nodes a case may have: no pod of a case asks for them, so they must not matter."""
    names = [f"n{index}" for index in range(NODES)]
    for name in names:
        rtt = [{"peer": peer, "p50Us": 9000, "p95Us": 9000, "count": 10} for peer in names if peer != name]
        await client.create(NODETELEMETRIES, {"metadata": {"name": name}})
        status = {"intervalSeconds": 600, "rtt": rtt}
        await client.patch(NODETELEMETRIES, name, {"status": status}, subresource="status")


class _Arena:
    """One control plane with both schedulers running."""

    def __init__(self, pods: Pods, http: aiohttp.ClientSession, oracle: Process, ours: Process, *, shrunk: int) -> None:
        """The first `shrunk` differences are made small."""
        self._shrunk = shrunk
        self._stage = Stage(pods.client, (parity_oracle.SCHEDULER_NAME, OURS))
        self._prober = Prober(pods, http, OracleLog(oracle.log_path), ours)

    async def run(self, cases: Iterator[Numbered], seed: str, say: Callable[[str], None]) -> Report:
        report = Report(seed)
        started = time.monotonic()
        for done, each in enumerate(cases, start=1):
            await self._take(each, report)
            if done % PER_WORD == 0:
                rate = report.cases / (time.monotonic() - started)
                say(f"{report.cases} cases, {rate:.1f}/s, {len(report.found)} differences")
        report.seconds = time.monotonic() - started
        return report

    async def _take(self, each: Numbered, report: Report) -> None:
        try:
            theirs, unequal = await self._compared(each)
        except REFUSALS as error:
            report.refused_by_server(each.case, str(error))
            return
        report.take(each.case, theirs)
        if unequal:
            objects = await self._smallest(each) if len(report.found) < self._shrunk else each.case.objects
            names = {"number": each.number, "families": each.case.families, "profile": each.profile}
            report.differs(each.case, {**names, "differences": unequal, "objects": objects})

    async def _compared(self, each: Numbered) -> tuple[Verdict, list[str]]:
        """kube-scheduler's verdict, and how ours differs when it has been tried again and again."""
        for settle_s in SETTLE_S:
            try:
                theirs, ours = await self._both(each, settle_s)
            except (Forbidden, NotFound):
                # A class that admission has not seen yet, or a pod of the case before that was evicted late.
                if settle_s == SETTLE_S[-1]:
                    raise
                await asyncio.sleep(settle_s)
                continue
            unequal = judged(each.case, theirs, ours)
            failures = list_failures(theirs, ours) if unequal else []
            if failures:
                unequal = await self._compare_failures(each, settle_s, failures)
            if not unequal:
                break
        return theirs, unequal

    async def _compare_failures(
        self, numbered: Numbered, settle_s: float, failures: Sequence[tuple[str, str]]
    ) -> list[str]:
        """Every way in which the two differ on the nodes whose pools ended the attempts, each node alone.

        Pools of several nodes may end an attempt, and each scheduler names the one that it met first.
        """
        unequal: list[str] = []
        for node, message in failures:
            case = keep_node(numbered.case, node)
            verdicts = await self._both(replace(numbered, case=case), settle_s)
            unequal += judged(case, *verdicts)
            unequal += [f"on {node} alone: {verdict.message!r}" for verdict in verdicts if verdict.message != message]
        return unequal

    async def _both(self, each: Numbered, settle_s: float) -> tuple[Verdict, Verdict]:
        case = each.case
        try:
            await self._build(case, settle_s)
            theirs = await self._prober.verdict(case, parity_oracle.SCHEDULER_NAME, each.profile)
            if theirs.preempts or (theirs.node and _binds_volumes(case)) or names_claims(case):
                await self._stage.clear()
                await self._build(case, settle_s)
            return theirs, await self._prober.verdict(case, OURS, each.profile)
        finally:
            await self._stage.clear()

    async def _build(self, case: Case, settle_s: float) -> None:
        await self._stage.build(case)
        # Volumes and the rest come by other watches than pods, and more of them.
        await asyncio.sleep(settle_s * (2 if _has_volumes(case) or names_claims(case) else 1))

    async def _smallest(self, each: Numbered) -> Sequence[Json]:
        """What is left of the case when nothing more can be left out."""
        steps = reduction(each.case.objects, attempts=ATTEMPTS)
        try:
            candidate = next(steps)
            while True:
                case = replace(each.case, objects=candidate)
                if not _has_its_claims(case):
                    candidate = steps.send(False)
                    continue
                try:
                    theirs, ours = await self._both(replace(each, case=case), SETTLE_S[1])
                    candidate = steps.send(bool(judged(case, theirs, ours)))
                except (*REFUSALS, KeyError):
                    # The API server does not take it, or it lacks what a case must have.
                    candidate = steps.send(False)
        except StopIteration as stop:
            smallest: Sequence[Json] = stop.value
            return smallest


def keep_node(case: Case, name: str) -> Case:
    """The case with one of its nodes, and the pods there."""
    objects = tuple(
        each
        for each in case.objects
        if (each["kind"] != "Node" or each["metadata"]["name"] == name)
        and (each["kind"] != "Pod" or each["spec"].get("nodeName", name) == name)
    )
    return replace(case, objects=objects)


def _has_its_claims(case: Case) -> bool:
    """A pod without its ResourceClaims is held before the queue, and neither scheduler says a word."""
    claims = {each["metadata"]["name"] for each in case.objects if each["kind"] == "ResourceClaim"}
    return claims.issuperset(each.get("resourceClaimName", "") for each in case.pod["spec"].get("resourceClaims") or ())


def _has_volumes(case: Case) -> bool:
    return any(each["kind"] == "PersistentVolumeClaim" for each in case.objects)


def _binds_volumes(case: Case) -> bool:
    """Claims may get a volume, or a node that is to make one."""
    claims = [each for each in case.objects if each["kind"] == "PersistentVolumeClaim"]
    return any((each.get("status") or {}).get("phase") not in {"Bound", "Lost"} for each in claims)
