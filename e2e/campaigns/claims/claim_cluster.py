"""A small cluster of coroutines: operators, schedulers, sweepers and controllers, all on one store.

Every request waits at a gate. A director opens one gate at a time, kills processes there, or loses their answers, so a
run is one interleaving; hypothesis looks for those that break the promises of the protocol.
"""

import asyncio
import contextlib
import random
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec
from tests.support.claims.objects import app_holder, app_json, deployment_json, labels, node_json, pod_json, pool_json
from tests.support.claims.store import Store

from robotapp_api.values.quantities.ranges import parse_ids
from robotapp_claims.protocol.bind_check import check_bind_all
from robotapp_claims.protocol.domains import ensure_domain
from robotapp_claims.protocol.sweeper import Sweeper
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_claims.rules.usage import named_ids
from robotapp_client.api.bodies import JSON
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, NODES, PODS, REPLICASETS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_client.transport.errors import ApiError, Unreachable

Json = dict[str, Any]
TURNS = 100
"""Of the event loop, within which an actor must come to its next gate."""


class Killed(Exception):  # noqa: N818 - a process that is killed, not an error of ours
    """The process dies at this request."""


@dataclass
class Actor:
    """One process: runs `work` again and again; `gate` is where it waits for the director."""

    name: str
    work: Callable[[ApiClient], Awaitable[None]]
    gate: asyncio.Future[str] | None = None
    idle: bool = True
    task: asyncio.Task[None] | None = None


@dataclass
class ClaimCluster:
    """apps: name -> uid of the apps ever created. deleted: uids of those that are gone."""

    ids: str = "1-2"
    chance: random.Random = field(default_factory=lambda: random.Random(0))
    now: float = 0.0
    store: Store = field(default_factory=Store)
    actors: list[Actor] = field(default_factory=list)
    apps: dict[str, str] = field(default_factory=dict)
    pods_made: int = 0

    def __post_init__(self) -> None:
        self.store.put(DOMAINPOOLS, pool_json(self.ids, quarantine_s=5))
        self.store.put(NODES, node_json("edge-1"))

    # People

    def create_app(self, name: str) -> None:
        self.apps[name] = self.store.put(ROBOTAPPS, app_json(name))["metadata"]["uid"]

    def delete_app(self, name: str) -> None:
        if self.store.find(ROBOTAPPS, name, "team"):
            self.store.remove(ROBOTAPPS, name, "team")

    def toggle_ros(self, name: str) -> None:
        """A ROS 1 app wants no domain; back to ROS 2 it wants one again."""
        app = self.store.find(ROBOTAPPS, name, "team")
        if app is not None:
            version = 1 if app["spec"].get("ros", {}).get("version", 2) == 2 else 2
            self.store.put(ROBOTAPPS, app | {"spec": app["spec"] | {"ros": {"version": version}}})

    # Processes of ours

    async def operate(self, client: ApiClient, name: str) -> None:
        """Rule 5 as the operator does it: ensure the domain, then write the template with its fence."""
        app = self.store.find(ROBOTAPPS, name, "team")
        if app is None:
            return
        uid = app["metadata"]["uid"]
        if app["spec"].get("ros", {}).get("version") == 1:
            found = self.store.find(DEPLOYMENTS, name, "team")
            if found is not None:
                await client.delete(DEPLOYMENTS, name, namespace="team", uid=found["metadata"]["uid"])
            return
        cached = [msgspec.convert(claim, Claim) for claim in self.store.all(ROBOTCLAIMS)]  # old when it is looked at
        request = DomainRequest(app_holder(uid, name=name))
        outcome = await ensure_domain(client, request, known_claims=lambda: cached)
        if outcome.gone:
            return
        fence = outcome.fences.get(name)
        if outcome.id is None:
            if name in outcome.unheld and fence:
                await self._write(client, name, uid, number=None, fence=fence)
            return
        current = self.store.find(DEPLOYMENTS, name, "team")
        body = deployment_json(outcome.id, uid=uid, name=name, claim=outcome.claim)
        if fence is None:
            await client.create(DEPLOYMENTS, body, namespace="team")
        elif current is None or current["spec"] != body["spec"]:
            await self._write(client, name, uid, number=outcome.id, fence=fence, claim=outcome.claim)

    async def _write(
        self, client: ApiClient, name: str, uid: str, *, number: int | None, fence: Any, claim: str = ""
    ) -> None:
        """number None: scale to 0; the template stays, but no longer names a claim that others may need."""
        if number is None:
            old = self.store.find(DEPLOYMENTS, name, "team")
            body = msgspec.json.decode(msgspec.json.encode(old)) if old else deployment_json(None, uid=uid, name=name)
            body["spec"]["replicas"] = 0
            body["spec"]["template"].pop("metadata", None)
        else:
            body = deployment_json(number, uid=uid, name=name, claim=claim)
        body["metadata"] |= {"uid": fence.uid, "resourceVersion": fence.resource_version}
        await client.replace(DEPLOYMENTS, body, namespace="team")

    async def schedule(self, client: ApiClient) -> None:
        """Bind the first pending pod whose claim stands, as our scheduler does: the claim names the node before."""
        await self._bind_first(client, nodes=["edge-1"])

    async def schedule_elsewhere(self, client: ApiClient) -> None:
        """The same by another scheduler behind our gate (rule 6), of which nobody knows the node before."""
        await self._bind_first(client, nodes=[])

    async def _bind_first(self, client: ApiClient, *, nodes: list[str]) -> None:
        for obj in self.store.all(PODS):
            if obj["spec"].get("nodeName"):
                continue
            seen = await client.get(PODS, obj["metadata"]["name"], namespace="team", as_type=Pod)
            (verdict,) = await check_bind_all(client, [seen], nodes=nodes)
            if not verdict.allowed:
                continue
            pod = await client.get(PODS, obj["metadata"]["name"], namespace="team")
            if pod["metadata"]["uid"] == seen.metadata.uid and not pod["spec"].get("nodeName"):
                await bind_pod(client, pod["metadata"], "edge-1")
                return

    def sweeping(self) -> Callable[[ApiClient], Awaitable[None]]:
        sweeper: Sweeper | None = None

        async def sweep(client: ApiClient) -> None:
            nonlocal sweeper
            if sweeper is None:
                sweeper = Sweeper(client, clock=lambda: self.now, limit=1)  # a gate is for one request
            await sweeper.sweep_once()

        return sweep

    # Processes of Kubernetes: garbage collector, controllers, kubelet; one small step per call, on what is there now

    async def control(self, client: ApiClient) -> None:
        """Look at the objects in any order and do the first thing there is to do."""
        steps: list[Callable[[], Awaitable[bool]]] = [
            *(partial(self._collect, client, obj) for obj in self.store.all(DEPLOYMENTS)),
            *(partial(self._replica_set, client, obj) for obj in self.store.all(DEPLOYMENTS)),
            *(partial(self._pods, client, obj) for obj in self.store.all(REPLICASETS)),
            *(partial(self._kubelet, client, obj) for obj in self.store.all(PODS)),
        ]
        self.chance.shuffle(steps)
        for step in steps:
            if await step():
                return

    async def _collect(self, client: ApiClient, deployment: Json) -> bool:
        meta = deployment["metadata"]
        if self._other_owner(deployment):
            await client.delete(DEPLOYMENTS, meta["name"], namespace="team", uid=meta["uid"])
            return True
        return False

    async def _kubelet(self, client: ApiClient, pod: Json) -> bool:
        if pod["metadata"].get("deletionTimestamp"):
            path = PODS.path("team", pod["metadata"]["name"])
            await client.request("DELETE", path, msgspec.json.encode({"gracePeriodSeconds": 0}), JSON)
            return True
        if self.store.find(REPLICASETS, pod["metadata"]["ownedBy"], "team") is None:
            await self._end(client, pod)
            return True
        return False

    def _other_owner(self, deployment: Json) -> bool:
        app = self.store.find(ROBOTAPPS, deployment["metadata"]["name"], "team")
        return app is None or app["metadata"]["uid"] != deployment["metadata"]["labels"]["robotics.io/app-uid"]

    async def _replica_set(self, client: ApiClient, deployment: Json) -> bool:
        meta, spec = deployment["metadata"], deployment["spec"]
        named = _number(spec["template"])
        name = f"{meta['name']}-{meta['labels']['robotics.io/app-uid']}-{named}"
        if spec["replicas"] and self.store.find(REPLICASETS, name, "team") is None:
            body = {"metadata": {**meta, "name": name, "ownedBy": meta["name"]}, "spec": spec}
            await client.create(REPLICASETS, body, namespace="team")
            return True
        return False

    async def _pods(self, client: ApiClient, replica_set: Json) -> bool:
        meta = replica_set["metadata"]
        owner = self.store.find(DEPLOYMENTS, meta["ownedBy"], "team")
        same = (
            owner is not None
            and owner["spec"]["replicas"]
            and owner["metadata"]["labels"] == meta["labels"]
            and _number(owner["spec"]["template"]) == _number(replica_set["spec"]["template"])
        )
        mine = [p for p in self.store.all(PODS) if p["metadata"].get("ownedBy") == meta["name"]]
        alive = [p for p in mine if not p["metadata"].get("deletionTimestamp")]
        if not same:
            for pod in alive:
                await self._end(client, pod)
                return True
            if not mine:
                await client.delete(REPLICASETS, meta["name"], namespace="team")
                return True
            return False
        if len(alive) > 1:
            await self._end(client, alive[-1])
            return True
        if not alive:
            self.pods_made += 1
            uid = meta["labels"]["robotics.io/app-uid"]
            body = pod_json(_number(replica_set["spec"]["template"]), name=f"pod-{self.pods_made}", uid=uid)
            body["metadata"] |= {"ownedBy": meta["name"], "labels": labels(uid, app=meta["ownedBy"])}
            body["metadata"]["annotations"] = replica_set["spec"]["template"]["metadata"]["annotations"]
            await client.create(PODS, body, namespace="team")
            return True
        return False

    async def _end(self, client: ApiClient, pod: Json) -> None:
        name = pod["metadata"]["name"]
        if pod["spec"].get("nodeName"):
            pod = await client.get(PODS, name, namespace="team")
        await client.delete(PODS, name, namespace="team", resource_version=pod["metadata"]["resourceVersion"])

    # What must hold at every moment

    def broken(self) -> str:
        users: dict[int, str] = {}
        for obj in self.store.all(PODS):
            pod = msgspec.convert(obj, Pod)
            if not pod.spec.node_name:
                continue
            (number,) = named_ids(pod.spec)
            uid = pod.metadata.app_uid
            if users.setdefault(number, uid) != uid:
                return f"DOUBLE: {users[number]} and {uid} both run on {number}"
            claim = self.store.find(ROBOTCLAIMS, f"dds.default.c.{number}")
            if claim is None or claim["spec"]["holder"]["uid"] != uid:
                return f"LOST: {pod.metadata.name} of {uid} runs on {number} without its claim"
        return ""

    def wanting(self) -> list[str]:
        """What is not as it should be when everything has come to rest."""
        wrong = []
        live = {
            app["metadata"]["uid"]
            for app in self.store.all(ROBOTAPPS)
            if app["spec"].get("ros", {}).get("version", 2) == 2
        }
        holders = [claim["spec"]["holder"]["uid"] for claim in self.store.all(ROBOTCLAIMS)]
        running = [
            p["metadata"]["labels"]["robotics.io/app-uid"] for p in self.store.all(PODS) if p["spec"].get("nodeName")
        ]
        if sorted(holders) != sorted(running) or len(set(holders)) != len(holders) or not set(holders) <= live:
            wrong.append(f"claims {holders}, running {running}, live {live}")
        if len(holders) < min(len(live), len(parse_ids(self.ids))):
            wrong.append(f"{len(live)} apps live, only {len(holders)} served")
        return wrong


async def bind_pod(client: ApiClient, meta: Json, node: str) -> None:
    """Binds a pod as it was read: its uid, its version and the annotations it is to have."""
    kept = {name: meta.get(name) for name in ("name", "uid", "resourceVersion", "annotations")}
    body = {"metadata": kept, "target": {"kind": "Node", "name": node}}
    await client.post_raw(PODS.path(meta["namespace"], meta["name"], "binding"), msgspec.json.encode(body))


def _number(template: Json) -> int | None:
    env = template["spec"]["containers"][0]["env"]
    return int(env[0]["value"]) if env else None


class Director:
    """Opens one gate at a time. `choose(n)` picks among n actors; `fate()` is "go", "die" or "lose"."""

    def __init__(self, cluster: ClaimCluster) -> None:
        self.cluster = cluster
        self.steps: list[str] = []

    def add(self, name: str, work: Callable[[ApiClient], Awaitable[None]]) -> None:
        self.cluster.actors.append(Actor(name, work))

    async def _run(self, actor: Actor) -> None:
        lost = False

        async def before(what: str) -> None:
            nonlocal lost
            actor.gate = asyncio.get_running_loop().create_future()
            fate = await actor.gate
            self.steps.append(f"{actor.name}: {what} ({fate})")
            if fate == "die":
                raise Killed
            lost = fate == "lose"

        async def after(what: str) -> None:
            if lost and not what.startswith(("get", "list")):
                raise Unreachable("answer lost", maybe_applied=True)

        client = self.cluster.store.client(before, after)
        while True:
            actor.idle = True
            actor.gate = asyncio.get_running_loop().create_future()
            await actor.gate
            actor.idle = False
            with contextlib.suppress(Killed, Unreachable, ApiError):
                await actor.work(client)

    async def step(self, choice: int, fate: str) -> None:
        """Let one actor do its next request (or begin its next round)."""
        actor = self.cluster.actors[choice % len(self.cluster.actors)]
        if actor.task is None:
            actor.task = asyncio.create_task(self._run(actor))
            await self._settle(actor.task, actor)
        if actor.gate is not None and not actor.gate.done():
            actor.gate.set_result(fate)
        await self._settle(actor.task, actor)
        if actor.task.done():
            actor.task.result()
        violation = self.cluster.broken()
        assert not violation, "\n".join([violation, *self.steps])

    async def _settle(self, task: asyncio.Task[None], actor: Actor) -> None:
        """Let the actor run until it stands before its next gate: nobody else can move meanwhile."""
        for _ in range(TURNS):
            if task.done() or (actor.gate is not None and not actor.gate.done()):
                return
            await asyncio.sleep(0)
        raise AssertionError(f"{actor.name} waits for something that is no gate of its own")

    async def round(self, index: int) -> None:
        """Let one actor come to the end of what it is at, or do one whole round of its work."""
        for _ in range(200):
            await self.step(index, "go")
            if self.cluster.actors[index].idle:
                return
        raise AssertionError(f"{self.cluster.actors[index].name} never ends its round")

    async def rest(self, *, without: int = -1, time_passes: bool = True, rounds: int = 60) -> None:
        """Everybody but one works until nobody writes any more."""
        for _ in range(rounds):
            before = self.cluster.store.version
            for index in range(len(self.cluster.actors)):
                if index != without:
                    await self.round(index)
            if self.cluster.store.version == before:
                return
            self.cluster.now += 6 if time_passes else 0
        raise AssertionError("\n".join(["they never stop writing", *self.steps[-200:]]))

    async def finish(self) -> None:
        """All faults are over: what must be, comes to be."""
        for _ in range(4):
            self.cluster.now += 6
            await self.rest()
        wrong = self.cluster.wanting()
        assert not wrong, "\n".join([*wrong, *self.steps[-400:]])

    async def close(self) -> None:
        for actor in self.cluster.actors:
            if actor.task:
                actor.task.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await actor.task
