"""The pod of a case through one scheduler on the live API server: what becomes of it first, and who is evicted for it.

All pods are watched, so nothing is asked twice, and a refusal that is replaced a moment later is seen too.
"""

import asyncio
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

import aiohttp
import msgspec

from campaigns.cluster_cases import Case
from campaigns.parity.oracle import SCHEDULER_NAME, OracleLog, Scores
from campaigns.parity.stage import HELD, delete_now
from campaigns.parity.verdict import FOUND, Verdict
from campaigns.rigs.watching import Watching
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS, RESOURCECLAIMS
from robotapp_client.informer.reflector import Change, Reflector
from robotapp_client.transport.errors import NotFound
from robotapp_testbed.processes.process import Process

Json = dict[str, Any]
OURS: Final = "ours"
NAME: Final = "new"
"""What the pod is called in texts, whatever its name was in this attempt."""
PATIENCE_S: Final = 60.0
EVICTIONS_S: Final = 10.0
QUIET_S: Final = 0.5
"""Who was to be evicted and is not yet gone was terminating from the start."""
LOOK_S: Final = 0.02
WRITES_S: Final = 10.0
DEALLOCATED: Final = "deallocation of ResourceClaim completed"


@dataclass
class Pods(Watching):
    """Every pod as it is now, and each version that was seen of those that are followed."""

    client: ApiClient
    now: dict[str, Json] = field(default_factory=dict)
    _followed: dict[str, list[Json]] = field(default_factory=dict)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    def __post_init__(self) -> None:
        self._reflector = Reflector(self.client, PODS, as_type=dict, on_change=self._on_change)

    def follow(self, key: str) -> list[Json]:
        """The versions of this pod from now on; the list grows."""
        return self._followed.setdefault(key, [])

    def forget(self, key: str) -> None:
        self._followed.pop(key, None)

    async def change(self, *, timeout_s: float) -> None:
        """Until any pod changes, or the time is over."""
        self._changed.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self._changed.wait()

    def _on_change(self, change: Change) -> None:
        if change.new is None:
            self.now.pop(change.key, None)
        else:
            self.now[change.key] = change.new
            if change.key in self._followed:
                self._followed[change.key].append(change.new)
        self._changed.set()


class Prober:
    """Puts one pod at a time before one of the two schedulers."""

    def __init__(self, pods: Pods, http: aiohttp.ClientSession, oracle_log: OracleLog, ours: Process) -> None:
        self._pods = pods
        self._client = pods.client
        self._http = http
        self._log = oracle_log
        self._ours = ours
        self._serial = 0

    async def verdict(self, case: Case, scheduler: str, profile: str = "") -> Verdict:
        """Create the pod, wait for the first decision, delete it. Raises ApiError when the pod itself is invalid."""
        self._serial += 1
        body = probe(case, f"{NAME}-{self._serial}", scheduler + profile)
        namespace, name = body["metadata"]["namespace"], body["metadata"]["name"]
        versions = self._pods.follow(f"{namespace}/{name}")
        try:
            await self._client.create(PODS, body, namespace=namespace)
            promised = str((case.objects[-1].get("status") or {}).get("nominatedNodeName") or "")
            if promised:
                await self._promise(namespace, name, promised)
            node, message = await self._decided(case, versions, scheduler=scheduler, promised=promised)
            victims = await self._victims(case, message)
            claims = await self._claims(case, versions, message) if names_claims(case) else {}
            next_node = versions[-1]["spec"].get("nodeName", "") if DEALLOCATED in message else ""
            # A pod that was refused may be tried again at any time, so scores are read only of those that are placed.
            is_placed = not message or bool(next_node)
            scores, best = await self._scores(scheduler, f"{namespace}/{name}") if is_placed else ({}, frozenset())
        finally:
            with suppress(NotFound):
                await delete_now(self._client, PODS.path(namespace, name))
            self._pods.forget(f"{namespace}/{name}")
        return Verdict(node, message.replace(name, NAME), scores, best, victims, claims, next_node)

    async def _promise(self, namespace: str, name: str, node: str) -> None:
        """The API server takes a nomination only of a pod that is there: it waits behind a gate for it."""
        status = {"status": {"nominatedNodeName": node}}
        await self._client.patch(PODS, name, status, namespace=namespace, subresource="status")
        await self._client.patch(PODS, name, {"spec": {"schedulingGates": None}}, namespace=namespace)

    async def _decided(
        self, case: Case, versions: list[Json], *, scheduler: str, promised: str
    ) -> tuple[str, str]:  # fmt: skip
        """(node, "") or (nominated node or "", text)."""
        waits = any("persistentVolumeClaim" in each for each in case.pod["spec"].get("volumes") or [])
        deadline_s = time.monotonic() + PATIENCE_S
        read = 0
        while time.monotonic() < deadline_s:
            for version in versions[read:]:
                if (found := told(version, promised=promised)) is not None:
                    return found
            read = len(versions)
            if waits and scheduler == OURS and versions:
                meta = versions[0]["metadata"]
                record = await self._record(f"{meta['namespace']}/{meta['name']}")
                if record is not None and record.get("node"):
                    return record["node"], ""
            await self._pods.change(timeout_s=LOOK_S if waits else 1.0)
        return "", f"no decision of {scheduler} within {PATIENCE_S:g} s"

    async def _victims(self, case: Case, message: str) -> tuple[str, ...]:
        """Who is gone, or going, that was not before: as many as the message says, less who was going already."""
        _, found, rest = message.partition(FOUND)
        if not found:
            return ()
        count = int(rest.rpartition("preempting ")[2].split()[0])
        going = sum(1 for each in case.objects if "deletionTimestamp" in each["metadata"])
        deadline_s = time.monotonic() + EVICTIONS_S
        while len(gone := self._gone(case)) < count and time.monotonic() < deadline_s:
            if len(gone) >= count - going:
                deadline_s = min(deadline_s, time.monotonic() + QUIET_S)
            await self._pods.change(timeout_s=LOOK_S)
        return gone

    def _gone(self, case: Case) -> tuple[str, ...]:
        """Pods are compared with what the case says of them: one that was terminating from the start tells by its condition."""
        found = []
        for pod in case.objects[:-1]:
            if pod["kind"] != "Pod" or not pod["spec"].get("nodeName"):
                continue
            meta = pod["metadata"]
            now = self._pods.now.get(f"{meta['namespace']}/{meta['name']}")
            before = _evicted(pod) or "deletionTimestamp" in meta
            if (
                now is None
                or (_evicted(now) and not _evicted(pod))
                or ("deletionTimestamp" in now["metadata"] and not before)
            ):
                found.append(meta["name"])
        return tuple(sorted(found))

    async def _claims(self, case: Case, versions: list[Json], message: str) -> Mapping[str, Json]:
        """Returns the pod's ResourceClaims once it is bound, or its refusal has been followed up."""
        deadline_s = time.monotonic() + (WRITES_S if not message else QUIET_S)
        freed = DEALLOCATED in message
        while time.monotonic() < deadline_s:
            claims = {name: await self._claim(case, name) for name in _claim_names(case)}
            is_bound = bool(versions) and bool(versions[-1]["spec"].get("nodeName"))
            if is_bound or (message and not freed):
                return claims
            await self._pods.change(timeout_s=LOOK_S)
        return claims

    async def _claim(self, case: Case, name: str) -> Json:
        """Returns what schedulers write of a claim, without names and times that differ from attempt to attempt."""
        stored = await self._client.get(RESOURCECLAIMS, name, namespace=case.pod["metadata"]["namespace"], as_type=dict)
        status = stored.get("status") or {}
        users = [
            {key: value for key, value in user.items() if key != "uid"} | {"name": _without_serial(user["name"])}
            for user in status.get("reservedFor") or ()
        ]
        allocation = dict(status.get("allocation") or {})
        allocation["allocationTimestamp"] = "set" if allocation.pop("allocationTimestamp", None) else "none"
        finalizers = stored["metadata"].get("finalizers") or []
        return {
            "finalizers": finalizers,
            "reservedFor": users,
            "allocation": allocation,
            "devices": status.get("devices"),
        }

    async def _scores(self, scheduler: str, key: str) -> tuple[Mapping[str, Mapping[str, int]], frozenset[str]]:
        if scheduler == SCHEDULER_NAME:
            scores = self._log.read().pop(key, Scores())
            return scores.plugins, frozenset(scores.best)
        record = await self._record(key)
        return (weighted(record["top"]) if record is not None and record.get("top") else {}), frozenset()

    async def _record(self, key: str) -> Json | None:
        async with self._http.get(f"{self._ours.health_url}/explain/{key}", ssl=False) as response:
            if response.status != 200:
                return None
            found: Json = msgspec.json.decode(await response.read())
            return found


def names_claims(case: Case) -> bool:
    """Returns whether the pod of a case names ResourceClaims, which its scheduler may write."""
    return bool(_claim_names(case))


def _claim_names(case: Case) -> list[str]:
    return [each["resourceClaimName"] for each in case.objects[-1]["spec"].get("resourceClaims") or ()]


def _without_serial(name: str) -> str:
    return NAME if name.startswith(f"{NAME}-") else name


def probe(case: Case, name: str, scheduler: str) -> Json:
    """The pod of a case under another name, for one scheduler."""
    pod = case.objects[-1]
    meta = {key: value for key, value in pod["metadata"].items() if key != "uid"} | {"name": name}
    spec = {**pod["spec"], "schedulerName": scheduler}
    if (pod.get("status") or {}).get("nominatedNodeName"):
        spec["schedulingGates"] = [{"name": HELD}]
    return {"apiVersion": "v1", "kind": "Pod", "metadata": meta, "spec": spec}


def told(pod: Json, *, promised: str) -> tuple[str, str] | None:
    """(node, text) once this version of a pod says what was decided.

    A pod whose volumes are still to be bound is nominated first; one that came with a promise says nothing by that.
    """
    status = pod["status"]
    if node := pod["spec"].get("nodeName"):
        return node, ""
    nominated = status.get("nominatedNodeName") or ""
    for each in status.get("conditions") or ():
        if (each["type"], each["status"]) == ("PodScheduled", "False") and each["reason"] != "SchedulingGated":
            return (nominated if FOUND in each["message"] else ""), each["message"]
    return (nominated, "") if nominated and not promised else None


def _evicted(pod: Json) -> bool:
    conditions = (pod.get("status") or {}).get("conditions") or ()
    return any((each["type"], each["status"]) == ("DisruptionTarget", "True") for each in conditions)


def weighted(top: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    """Node to plugin to weighted score, from the columns of an explain record."""
    return {
        node: {name: top["weights"][name] * scores[at] for name, scores in top["scores"].items()}
        for at, node in enumerate(top["nodes"])
    }
