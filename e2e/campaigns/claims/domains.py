"""What binding pods with a domain costs, and how much of it is that each claim names the node first (status.nodes).

Bare pods that ask for a domain, and pods of RobotApps whose claims stand, go through the scheduler's own reservation and
a Binding on a real control plane, `--at-once` of them at a time; the rounds take turns: without the write, with it.
"""

import argparse
import asyncio
import json
import statistics
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final
from unittest import mock

import msgspec
from tests.support.claims.objects import app_holder, pod_json

from campaigns.common.options import count, report
from campaigns.common.output import say
from campaigns.rigs.claims_live import Live, live
from robotapp_api.model.names import Annotation
from robotapp_claims.protocol.domains import ensure_pod_domain
from robotapp_claims.protocol.writes import create_claim
from robotapp_claims.rules.identity import claim_name, domain_spec
from robotapp_claims.rules.objects import ClaimSpec
from robotapp_client.api.resources import NODES, PODS, ROBOTCLAIMS
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.framework.handle import Readiness
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.shell.binding import claim_reserver
from robotapp_scheduler.shell.binding.claim_reserver import ClaimReserver
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.namespaces import created

Json = dict[str, Any]
IDS: Final = "1-101,215-232"
BATCH: Final = 64
"""Pods whose bind checks are asked in one call, as the scheduler does."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench domains", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pods", type=count(1, 119), default=100)
    parser.add_argument("--rounds", type=count(1, 100), default=6, help="of each kind, in turn")
    parser.add_argument("--at-once", type=count(1, 500), default=32)
    parser.add_argument("--json", type=report)
    arguments = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp)
        with created(cp, "domains") as namespace:
            found = asyncio.run(_run(cp, namespace, arguments))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(found, indent=1) + "\n")
    return 0


async def _run(cp: ControlPlane, namespace: str, arguments: argparse.Namespace) -> Json:
    async with live(cp, namespace) as place:
        await place.admin.create(NODES, {"metadata": {"name": place.node}})
        await place.make_pool(IDS)
        found: Json = {}
        for what, once in (("bare pods", _bare), ("pods of apps", _members)):
            rates: dict[str, list[float]] = {"without": [], "with": []}
            for _ in range(arguments.rounds):
                for kind, figures in rates.items():
                    figures.append(await _round(place, once, arguments, noting=kind == "with"))
            found[what] = rates
            before, now = (statistics.median(rates[kind]) for kind in ("without", "with"))
            say(f"{what}: {before:.0f} pods/s without the write, {now:.0f} with it ({100 * (now / before - 1):+.0f} %)")
            say(f"  {rates}")
        return found


Once = Callable[[Live, list[Json], argparse.Namespace], Awaitable[None]]


async def _round(place: Live, once: Once, arguments: argparse.Namespace, *, noting: bool) -> float:
    """Pods per second of one round."""
    pods = await _prepared(place, once, arguments.pods)
    async with _noting(noting):
        began_s = time.perf_counter()
        await once(place, pods, arguments)
        spent_s = time.perf_counter() - began_s
    await _clear(place)
    return float(arguments.pods / spent_s)


async def _prepared(place: Live, once: Once, pods: int) -> list[Json]:
    made = []
    for number in range(pods):
        if once is _bare:
            made.append(await place.make_pod(f"bare-{number}", None))
            continue
        holder = app_holder(f"uid-{number}", name=f"app-{number}")
        spec = domain_spec(pool=place.pool, scope="Cluster", scope_value="", domain_id=number + 1, holder=holder)
        spec = msgspec.structs.replace(spec, holder=msgspec.structs.replace(holder, namespace=place.namespace))
        await create_claim(place.operator, spec)
        made.append(await _member(place, spec, number + 1))
    return made


async def _member(place: Live, spec: ClaimSpec, number: int) -> Json:
    """Without an owner, which the garbage collector would not find."""
    notes = {str(Annotation.DOMAIN_CLAIM): claim_name(spec)}
    body = pod_json(number, name=f"member-{number}", uid=spec.holder.uid, annotations=notes, app=spec.holder.name)
    body["metadata"] = body["metadata"] | {"namespace": place.namespace, "ownerReferences": []}
    body["spec"] |= {"schedulerName": "nobody", "terminationGracePeriodSeconds": 0}
    body["spec"]["containers"][0]["image"] = "x"
    del body["status"]
    return await place.admin.create(PODS, body, namespace=place.namespace)


@asynccontextmanager
async def _noting(on: bool) -> AsyncIterator[None]:
    """Off: as it was before claims named nodes."""
    if on:
        yield
        return

    async def as_before(client: Any, request: Any, *, node: str = "") -> Any:  # noqa: ARG001 - that is the point
        return await ensure_pod_domain(client, request)

    async def nothing(_: Any, claim: Any, __: Any) -> Any:
        return claim

    with (
        mock.patch.object(claim_reserver, "ensure_pod_domain", as_before),
        mock.patch("robotapp_claims.protocol.bind_check.note_nodes", nothing),
    ):
        yield


async def _bare(place: Live, pods: list[Json], arguments: argparse.Namespace) -> None:
    turn = asyncio.Semaphore(arguments.at_once)
    reserver = ClaimReserver(place.scheduler)

    async def one(body: Json) -> None:
        async with turn:
            pod = _info(body, {str(Annotation.DDS_DOMAIN): "auto"})
            found = await reserver.reserve(pod, place.node, ())
            assert found.readiness is Readiness.READY, found
            await place.bind(place.scheduler, body, annotations=dict(found.annotations))

    await asyncio.gather(*map(one, pods))


async def _members(place: Live, pods: list[Json], arguments: argparse.Namespace) -> None:
    reserver, turn = ClaimReserver(place.scheduler), asyncio.Semaphore(arguments.at_once)

    async def bind(body: Json) -> None:
        async with turn:
            await place.bind(place.scheduler, body)

    for begin in range(0, len(pods), BATCH):
        batch = pods[begin : begin + BATCH]
        found = await reserver.check_domains([(_info(body, {}), place.node) for body in batch])
        assert all(one.readiness is Readiness.READY for one in found.values()), next(iter(found.values()))
        await asyncio.gather(*map(bind, batch))


def _info(body: Json, annotations: dict[str, str]) -> PodInfo:
    meta = body["metadata"] | {"annotations": {**(body["metadata"].get("annotations") or {}), **annotations}}
    return PodInfo(msgspec.convert(body | {"metadata": meta}, Pod))


async def _clear(place: Live) -> None:
    for pod in (await place.admin.list(PODS, namespace=place.namespace, as_type=dict)).items:
        await place.admin.delete(PODS, pod["metadata"]["name"], namespace=place.namespace)
    for claim in await place.claims():
        await place.admin.delete(ROBOTCLAIMS, claim.name)


if __name__ == "__main__":
    sys.exit(main())
