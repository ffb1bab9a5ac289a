"""A small cluster of coroutines: operators, schedulers, sweepers and controllers, all on one store.

Every request waits at a gate. A director opens one gate at a time, kills processes there, or loses their answers, so a
run is one interleaving; hypothesis looks for those that break the promises of the protocol.
"""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
from tests.support.claims_objects import app_holder, app_json, deployment_json, labels, pod_json, pool_json
from tests.support.claims_store import Client, Store

from robotapp_api.claims.domain import DomainRequest
from robotapp_api.claims.objects import Pod
from robotapp_api.claims.usage import named_ids
from robotapp_api.client.claims import check_bind, ensure_domain
from robotapp_api.client.errors import ApiError, Unreachable
from robotapp_api.client.resources import DEPLOYMENTS, DOMAINPOOLS, PODS, REPLICASETS, ROBOTAPPS, ROBOTCLAIMS
from robotapp_api.client.sweep import Sweeper

Json = dict[str, Any]


class Killed(Exception):  # noqa: N818 - a process that is killed, not an error of ours
    """The process dies at this request."""


@dataclass
class Actor:
    """One process: runs `work` again and again; `gate` is where it waits for the director."""

    name: str
    work: Callable[[Client], Awaitable[None]]
    gate: asyncio.Future[str] | None = None
    task: asyncio.Task[None] | None = None


@dataclass
class World:
    """apps: name -> uid of the apps ever created. deleted: uids of those that are gone."""

    ids: str = "1-2"
    now: float = 0.0
    store: Store = field(default_factory=Store)
    actors: list[Actor] = field(default_factory=list)
    apps: dict[str, str] = field(default_factory=dict)
    pods_made: int = 0

    def __post_init__(self) -> None:
        self.store.put(DOMAINPOOLS, pool_json(self.ids, quarantine_s=5))

    # People

    def create_app(self, name: str) -> None:
        self.apps[name] = self.store.put(ROBOTAPPS, app_json(name))["metadata"]["uid"]

    def delete_app(self, name: str) -> None:
        if self.store.find(ROBOTAPPS, name, "team"):
            self.store.remove(ROBOTAPPS, name, "team")

    # Processes of ours

    async def operate(self, client: Client, name: str) -> None:
        """Rule 5 as the operator does it: ensure the domain, then write the template with its fence."""
        if self.store.find(ROBOTAPPS, name, "team") is None:
            return
        uid = self.apps[name]
        outcome = await ensure_domain(client, DomainRequest(app_holder(uid, name=name)))
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
        self, client: Client, name: str, uid: str, *, number: int | None, fence: Any, claim: str = ""
    ) -> None:
        """number None: scale to 0, the template stays."""
        if number is None:
            old = self.store.find(DEPLOYMENTS, name, "team")
            body = msgspec.json.decode(msgspec.json.encode(old)) if old else deployment_json(None, uid=uid, name=name)
            body["spec"]["replicas"] = 0
        else:
            body = deployment_json(number, uid=uid, name=name, claim=claim)
        body["metadata"] |= {"uid": fence.uid, "resourceVersion": fence.resource_version}
        await client.replace(DEPLOYMENTS, body, namespace="team")

    async def schedule(self, client: Client) -> None:
        """Bind the first pending pod whose claim stands."""
        for obj in self.store.all(PODS):
            if obj["spec"].get("nodeName"):
                continue
            seen = await client.get(PODS, obj["metadata"]["name"], namespace="team", as_type=Pod)
            if not (await check_bind(client, seen)).allowed:
                continue
            pod = await client.get(PODS, obj["metadata"]["name"], namespace="team")
            if pod["metadata"]["uid"] == seen.metadata.uid and not pod["spec"].get("nodeName"):
                pod["spec"]["nodeName"] = "edge-1"
                pod["status"] = {"phase": "Running"}
                await client.replace(PODS, pod, namespace="team")
                return

    def sweeping(self) -> Callable[[Client], Awaitable[None]]:
        sweeper: Sweeper | None = None

        async def sweep(client: Client) -> None:
            nonlocal sweeper
            if sweeper is None:
                sweeper = Sweeper(client, clock=lambda: self.now)
            await sweeper.sweep_once()

        return sweep

    # Processes of Kubernetes: garbage collector, controllers, kubelet; one small step per call, on what is there now

    async def control(self, client: Client) -> None:
        for deployment in self.store.all(DEPLOYMENTS):
            meta = deployment["metadata"]
            if self.store.find(ROBOTAPPS, meta["name"], "team") is None or self._other_owner(deployment):
                await client.delete(DEPLOYMENTS, meta["name"], namespace="team", uid=meta["uid"])
                return
            if await self._replica_set(client, deployment):
                return
        for replica_set in self.store.all(REPLICASETS):
            if await self._pods(client, replica_set):
                return
        for pod in self.store.all(PODS):
            if pod["metadata"].get("deletionTimestamp"):
                await client.delete(PODS, pod["metadata"]["name"], namespace="team")
                return
            if self.store.find(REPLICASETS, pod["metadata"]["ownedBy"], "team") is None:
                await self._end(client, pod)
                return

    def _other_owner(self, deployment: Json) -> bool:
        app = self.store.find(ROBOTAPPS, deployment["metadata"]["name"], "team")
        return app is None or app["metadata"]["uid"] != deployment["metadata"]["labels"]["robotics.io/app-uid"]

    async def _replica_set(self, client: Client, deployment: Json) -> bool:
        meta, spec = deployment["metadata"], deployment["spec"]
        named = _number(spec["template"])
        name = f"{meta['name']}-{meta['labels']['robotics.io/app-uid']}-{named}"
        if spec["replicas"] and self.store.find(REPLICASETS, name, "team") is None:
            body = {"metadata": {**meta, "name": name, "ownedBy": meta["name"]}, "spec": spec}
            await client.create(REPLICASETS, body, namespace="team")
            return True
        return False

    async def _pods(self, client: Client, replica_set: Json) -> bool:
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

    async def _end(self, client: Client, pod: Json) -> None:
        name = pod["metadata"]["name"]
        if pod["spec"].get("nodeName"):
            pod = await client.get(PODS, name, namespace="team")
            pod["metadata"]["deletionTimestamp"] = "now"
            await client.replace(PODS, pod, namespace="team")
        else:
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
        live = {app["metadata"]["uid"] for app in self.store.all(ROBOTAPPS)}
        holders = [claim["spec"]["holder"]["uid"] for claim in self.store.all(ROBOTCLAIMS)]
        running = [
            p["metadata"]["labels"]["robotics.io/app-uid"] for p in self.store.all(PODS) if p["spec"].get("nodeName")
        ]
        if sorted(holders) != sorted(running) or len(set(holders)) != len(holders) or not set(holders) <= live:
            wrong.append(f"claims {holders}, running {running}, live {live}")
        if len(holders) < min(len(live), 2):
            wrong.append(f"{len(live)} apps live, only {len(holders)} served")
        return wrong


def _number(template: Json) -> int | None:
    env = template["spec"]["containers"][0]["env"]
    return int(env[0]["value"]) if env else None


class Director:
    """Opens one gate at a time. `choose(n)` picks among n actors; `fate()` is "go", "die" or "lose"."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.steps: list[str] = []

    def add(self, name: str, work: Callable[[Client], Awaitable[None]]) -> None:
        self.world.actors.append(Actor(name, work))

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

        client = self.world.store.client(before, after)
        while True:
            actor.gate = asyncio.get_running_loop().create_future()
            await actor.gate
            with contextlib.suppress(Killed, Unreachable, ApiError):
                await actor.work(client)

    async def step(self, choice: int, fate: str) -> None:
        """Let one actor do its next request (or begin its next round)."""
        await self._settle()
        actor = self.world.actors[choice % len(self.world.actors)]
        if actor.task is None:
            actor.task = asyncio.create_task(self._run(actor))
            await self._settle()
        if actor.gate is not None and not actor.gate.done():
            actor.gate.set_result(fate)
        await self._settle()
        if actor.task.done():
            actor.task.result()
        violation = self.world.broken()
        assert not violation, "\n".join([violation, *self.steps])

    async def _settle(self) -> None:
        for _ in range(4):
            await asyncio.sleep(0)

    async def finish(self, rounds: int = 60) -> None:
        """Everybody works without faults until nothing is left to do; time passes."""
        for _ in range(rounds):
            self.world.now += 6
            for index in range(len(self.world.actors)):
                for _ in range(30):
                    await self.step(index, "go")
            if not self.world.wanting():
                return
        raise AssertionError("\n".join([*self.world.wanting(), *self.steps[-400:]]))

    async def close(self) -> None:
        for actor in self.world.actors:
            if actor.task:
                actor.task.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await actor.task
