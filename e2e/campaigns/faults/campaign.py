"""One fault at a time on a live control plane: fill it, let the scheduler loose, hurt it, wait for rest, judge."""

import asyncio
import json
import math
import random
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import msgspec
import yaml
from tests.support.proxy import FaultProxy

from campaigns.faults.crew import Crew
from campaigns.faults.history import Room
from campaigns.faults.injected import FAULTS
from campaigns.faults.observer import CPU_LABEL, Observer
from campaigns.faults.run import REST_LOOK_S, Plan, Run
from campaigns.scheduler import load
from campaigns.speed import contestants
from campaigns.speed.contestants import OURS
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import NAMESPACES, NODES, PODS
from robotapp_client.transport.errors import ApiError, ClientError, NotFound, Unreachable
from robotapp_client.transport.kubeconfig import load as login
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import install, start_scheduler
from robotapp_testbed.processes.process import Process


@dataclass(frozen=True, slots=True)
class Counted:
    """Per pod name the bindings that were answered with success, and how many were not."""

    successes: Counter[str] = field(default_factory=Counter)
    refused: int = 0


class Bindings:
    """Reads on where the last call ended. Needs a control plane with an audit log."""

    def __init__(self, cp: ControlPlane) -> None:
        self._path = cp.logs_dir / "audit.jsonl"
        self._offset = 0

    def since_last(self) -> Counted:
        successes: Counter[str] = Counter()
        refused = 0
        with self._path.open("rb") as file:
            file.seek(self._offset)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                self._offset += len(line)
                if b'"subresource":"binding"' not in line:
                    continue
                try:
                    record = json.loads(line)
                except ValueError:  # two halves where the server was killed
                    continue
                if record.get("responseStatus", {}).get("code", 500) < 300:
                    successes[record["objectRef"]["name"]] += 1
                else:
                    refused += 1
        return Counted(successes, refused)


Json = dict[str, Any]
NAMESPACE = "faults"
SIZES_MILLI = (50, 100, 200, 250)
NODE_PODS, NODE_CPU_MILLI = 110, 16_000
CHURN = 0.05
"""Part of the pods that are deleted once they are bound, and replaced: "at any moment" means little without it."""
QUIET_S = 5.0
QUIET_CPU_S = 0.1
"""Seconds of CPU per second a scheduler may use at rest, everything included."""
QUIET_WRITES = 4
QUIET_LOOKS = 6
"""And one more per 200 pods: events trail behind the binds, on a busy machine by minutes. A loop that is hot is so in every look."""
EMPTY_S = 300.0


class Campaign:
    """One control plane for all runs."""

    def __init__(self, cp: ControlPlane) -> None:
        self.cp = cp
        self._bindings = Bindings(cp)
        self._runs = 0

    async def __aenter__(self) -> Self:
        await asyncio.to_thread(install, self.cp)
        endpoint = await asyncio.to_thread(login, self.cp.kubeconfig("admin"))
        self._client = ApiClient(endpoint, user_agent="robotapp-faults", max_connections=load.CONNECTIONS)
        await self._client.__aenter__()
        await self._client.create(NAMESPACES, {"metadata": {"name": NAMESPACE}})
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._client.__aexit__(*error)

    async def run(self, plan: Plan) -> Json:
        """One fault from an empty namespace to an empty namespace. Everything that was broken is in "problems"."""
        self._runs += 1
        chance = random.Random(f"{plan.seed}-{plan.fault}-{plan.pods}")
        pods = _pods(plan, chance, prefix=f"r{self._runs:02}")
        rooms = _rooms(plan, pods)
        await contestants.hold_lease(self._client, OURS)
        await self._set_nodes(rooms)
        await load.each(pods, lambda pod: self._client.create(PODS, pod, namespace=NAMESPACE))
        with FaultProxy(seed=plan.seed) as proxy:
            crew = Crew(lambda number: self._start(plan, proxy, number), plan.schedulers)
            async with Observer(self._client, NAMESPACE, rooms) as observer, crew:
                run = Run(plan, self.cp, self._client, proxy, observer, crew, chance)
                await self._filled(run)
                await contestants.drop_lease(self._client, OURS)
                run.started_s = time.monotonic()
                churn = asyncio.create_task(_churn(run, f"r{self._runs:02}"))
                try:
                    await FAULTS[plan.fault].strike(run)
                    proxy.clear()
                    await churn
                    await self._rest(run)
                    figures = await _at_rest(run)
                except TimeoutError as late:
                    run.problems.append(str(late) or "too late")
                    figures = {}
                finally:
                    churn.cancel()
                    await asyncio.gather(churn, return_exceptions=True)
            found = self._verdict(run, figures)
        await self._empty()
        return found

    # --- the stage ------------------------------------------------------------------------------------------------

    def _start(self, plan: Plan, proxy: FaultProxy, number: int) -> Process:
        name = f"scheduler-{self._runs:02}-{number}"
        election = {"leaderElect": True, "resourceNamespace": OURS.lease_namespace, **plan.election}
        document = {
            "apiVersion": "kubescheduler.config.k8s.io/v1",
            "kind": "KubeSchedulerConfiguration",
            "leaderElection": election,
            "profiles": [{"schedulerName": OURS.scheduler_name}],
        }
        config = self.cp.run_dir / f"{name}.yaml"
        config.write_text(yaml.safe_dump(document))
        flags: Json = {"insecure_explain": True}
        if plan.through_proxy:
            flags["kubeconfig"] = proxy.route(name, self.cp.kubeconfig("scheduler")).kubeconfig
        return start_scheduler(self.cp, config=config, name=name, env=plan.environment, **flags)

    async def _set_nodes(self, rooms: Mapping[str, Room]) -> None:
        """Exactly these nodes."""
        have = {each["metadata"]["name"] for each in (await self._client.list(NODES)).items}
        await load.each([_node(name, room) for name, room in rooms.items() if name not in have], self._create_node)
        await load.each(sorted(have - set(rooms)), lambda name: self._client.delete(NODES, name))

    async def _empty(self) -> None:
        """Ten thousand pods at once take a busy API server longer than an answer may take."""
        deadline_s = time.monotonic() + EMPTY_S
        while True:
            try:
                await load.delete_pods(self._client, NAMESPACE)
                await load.delete_events(self._client, NAMESPACE)
            except Unreachable:
                if time.monotonic() > deadline_s:
                    raise
            else:
                return

    async def _create_node(self, node: Json) -> None:
        await self._client.create(NODES, node)
        await self._client.patch(NODES, node["metadata"]["name"], {"spec": {"taints": None}})  # admission's "not ready"

    async def _filled(self, run: Run) -> None:
        """Every scheduler knows every pod."""
        deadline_s = time.monotonic() + 120
        for member in run.crew.members:
            while _pending(await asyncio.to_thread(member.metrics)) < run.plan.pods:
                if time.monotonic() > deadline_s:
                    raise TimeoutError(f"{member.process.name} does not see all pods")
                await asyncio.sleep(0.2)

    async def _rest(self, run: Run) -> None:
        """Wait until every pod is bound, or told that no node has room for it. Raises TimeoutError."""
        within_s = 120 + run.plan.pods / 20
        deadline_s = time.monotonic() + within_s
        while left := run.observer.history.unsettled():
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{len(left)} pods do not come to rest in {within_s:.0f} s: {'; '.join(left[:3])}")
            await asyncio.sleep(REST_LOOK_S)

    def _verdict(self, run: Run, figures: Mapping[str, float]) -> Json:
        history, plan = run.observer.history, run.plan
        history.settle()
        counted = self._bindings.since_last()
        twice = [f"{name} was bound {count} times" for name, count in counted.successes.items() if count > 1]
        problems = [*run.problems, *history.problems, *twice, *run.crew.problems, *map(repr, run.proxy.errors)]
        moments = [moment for moment in run.observer.bind_s if moment >= run.started_s]
        after = [moment for moment in moments if moment >= run.over_s]
        return {
            "fault": plan.fault,
            "room": plan.room,
            "seed": plan.seed,
            "pods": plan.pods,
            "bound": history.bound,
            "reported": len(history.unbound),
            "binds": history.binds,
            "refused bindings": counted.refused,
            "watch gaps": run.observer.gaps,
            "seconds": round(moments[-1] - run.started_s, 1) if moments else math.nan,
            "recovery s": round(after[0] - run.over_s, 2) if run.over_s and after else 0.0,
            "restarts": run.crew.restarts,
            "peak RSS MB": round(run.crew.peak_rss_bytes / 1e6),
            "CPU ms/pod": round(1000 * run.crew.cpu_s / max(1, history.binds), 2),
            **figures,
            **run.notes,
            "problems": problems,
        }


def _pods(plan: Plan, chance: random.Random, *, prefix: str) -> list[Json]:
    return [_pod(f"{prefix}-{number:05}", chance.choice(SIZES_MILLI)) for number in range(plan.pods)]


def _pod(name: str, cpu_milli: int) -> Json:
    requests = {"cpu": f"{cpu_milli}m", "memory": "10Mi"}
    container = {"name": "main", "image": "registry.invalid/main:1", "resources": {"requests": requests}}
    return {
        "metadata": {"name": name, "labels": {CPU_LABEL: str(cpu_milli)}},
        "spec": {
            "schedulerName": OURS.scheduler_name,
            "terminationGracePeriodSeconds": 0,
            "containers": [container],
        },
    }


def _rooms(plan: Plan, pods: list[Json]) -> dict[str, Room]:
    """Equal nodes that together hold `plan.room` of what the pods ask for."""
    asked_milli = sum(int(pod["metadata"]["labels"][CPU_LABEL]) for pod in pods)
    whole_milli = math.floor(asked_milli * plan.room)
    count = math.ceil(whole_milli / min(NODE_CPU_MILLI, max(1000, asked_milli // 10)))
    cpu_milli = whole_milli // count
    room = Room(max(2, math.ceil(plan.pods * 1.15 / count)), cpu_milli)
    return {f"node-{number:04}-{cpu_milli}-{room.pods}": room for number in range(count)}


def _node(name: str, room: Room) -> Json:
    capacity = {"cpu": f"{room.cpu_milli}m", "memory": "256Gi", "pods": str(room.pods)}
    return {
        "metadata": {"name": name, "labels": {"kubernetes.io/hostname": name}},
        "status": {
            "capacity": capacity,
            "allocatable": capacity,
            "conditions": [{"type": "Ready", "status": "True", "reason": "KubeletReady"}],
        },
    }


async def _churn(run: Run, prefix: str) -> None:
    """Delete bound pods and create others, whatever becomes of the requests on the way."""
    wanted, done = int(run.plan.pods * CHURN), 0
    body = msgspec.json.encode({"kind": "DeleteOptions", "apiVersion": "v1", "gracePeriodSeconds": 0})
    while done < wanted:
        await asyncio.sleep(0.05)
        history = run.observer.history
        bound = history.bound_uids()
        if len(bound) < run.plan.pods * CHURN:
            continue
        for uid in run.random.sample(bound, min(5, wanted - done)):
            victim = history.live[uid]
            try:
                await run.client.request("DELETE", PODS.path(NAMESPACE, victim.name), body, "application/json")
            except ClientError as error:
                if isinstance(error, ApiError) and not isinstance(error, NotFound) and error.status < 429:
                    raise
                continue  # tried again with another one
            await _create(run.client, _pod(f"{prefix}-x{done:04}", victim.cpu_milli))
            done += 1


async def _create(client: ApiClient, pod: Json) -> None:
    while True:
        try:
            await client.create(PODS, pod, namespace=NAMESPACE)
        except ApiError as error:
            if error.status == 409:
                return
            if error.status < 429:
                raise
        except ClientError:
            pass
        else:
            return
        await asyncio.sleep(0.2)


def _pending(metrics: Mapping[str, Mapping[tuple[str, ...], float]]) -> float:
    return sum(metrics.get("scheduler_pending_pods", {}).values())


async def _at_rest(run: Run) -> dict[str, float]:
    """The leader's own account agrees with the watch, and it does nothing any more."""
    leader = await run.leader()
    looks, quiet = 0, False
    while not quiet and looks < QUIET_LOOKS + run.plan.pods // 200:
        looks += 1
        before, cpu_s = await asyncio.to_thread(leader.metrics), leader.process.cpu_seconds()
        await asyncio.sleep(QUIET_S)
        spent_s = (leader.process.cpu_seconds() - cpu_s) / QUIET_S
        after = await asyncio.to_thread(leader.metrics)
        writes = _writes(after) - _writes(before)
        quiet = spent_s <= QUIET_CPU_S and writes <= QUIET_WRITES
    history = run.observer.history
    waiting, cached = _pending(after), after.get("scheduler_cache_size", {})
    if waiting != len(history.unbound):
        run.problems.append(f"{waiting:.0f} pods in its queues, {len(history.unbound)} without a node")
    if cached.get(("pods",)) != history.bound or cached.get(("assumed_pods",)):
        run.problems.append(f"its cache holds {dict(cached)}, {history.bound} pods are bound")
    if spent_s > QUIET_CPU_S:
        run.problems.append(f"hot loop: {spent_s:.2f} s of CPU per second at rest")
    if writes > QUIET_WRITES:
        run.problems.append(f"hot loop: {writes:.0f} writes in {QUIET_S:.0f} s at rest")
    return {"CPU at rest": round(spent_s, 3), "writes at rest": writes, "looks until quiet": looks}


def _writes(metrics: Mapping[str, Mapping[tuple[str, ...], float]]) -> float:
    """Creates and patches; the lease is renewed by PUT."""
    sent = metrics.get("scheduler_api_requests_total", {})
    return sum(count for labels, count in sent.items() if labels[0] in ("POST", "PATCH", "DELETE"))
