"""An instance that waits for a full pool costs the API server nothing: the caches are enough to say so, never to take an id."""

from collections.abc import AsyncIterator
from typing import Any

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import app_body, component
from tests.unit.operating.reconcile.test_instance_reconciler import ReconciledServer

from robotapp_api.model.names import Reason
from robotapp_claims.rules.domain import DomainOutcome
from robotapp_claims.rules.identity import domain_spec, holder_of_app
from robotapp_claims.rules.objects import Claim, ClaimStatus, Meta, Pool, PoolMeta, PoolQuota, PoolSpec
from robotapp_operator.watch.lister import problems_now


@pytest.fixture
async def world() -> AsyncIterator[ReconciledServer]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        world = ReconciledServer(api, client)
        await world.pool("1-2")
        world.cache.pools["default"] = pool_of()
        yield world


def pool_of(**spec: Any) -> Pool:
    return Pool(metadata=PoolMeta(name="default"), spec=PoolSpec(ids="1-2", **spec))


def claimed(world: ReconciledServer, number: int, *, uid: str = "another", phase: str = "Reserved") -> Claim:
    """A claim that the cache shows."""
    holder = holder_of_app(namespace="default", name="a", uid=uid, instance="")
    spec = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number, holder=holder)
    claim = Claim(metadata=Meta(name=f"dds.default.c.{number}"), spec=spec, status=ClaimStatus(phase=phase))
    world.cache.claims.put(uid, claim.name, claim)
    return claim


async def reads(world: ReconciledServer, uid: str) -> int:
    """How many requests it takes."""
    before = len(world.api.requests)
    await world.children.reconcile(uid, "")
    return len(world.api.requests) - before


async def test_while_the_caches_show_every_id_in_other_hands_nothing_is_asked_and_the_reason_is_known(
    world: ReconciledServer,
) -> None:
    claimed(world, 1)
    claimed(world, 2, phase="Draining")
    uid = await world.app()
    assert await reads(world, uid) == 0
    outcome = world.memory.outcome(uid, "")
    assert outcome is not None
    assert outcome.reason == Reason.DOMAIN_EXHAUSTED
    assert outcome.message.startswith("2 of 2 domain ids of pool default are claimed, 1 of them resting up to 60 s")
    assert world.memory.without_domain() == [(uid, "")], "it stands in the line"


async def test_an_app_that_waits_and_is_edited_to_a_spec_that_is_refused_leaves_the_line(
    world: ReconciledServer,
) -> None:
    claimed(world, 1)
    claimed(world, 2)
    uid = await world.app()
    assert await reads(world, uid) == 0
    assert world.memory.without_domain() == [(uid, "")]
    record = world.cache.apps[uid]
    world.cache.update_app(
        app_body(
            record.name,
            uid=uid,
            generation=2,
            components=[component("a", args=["$(ROBOTAPP_NODE)"], dependsOn=[{"component": "b", "status": "Ready"}])],
        )
    )
    assert problems_now(world.cache.apps[uid].app, world.cache)
    assert await reads(world, uid) == 0
    assert world.memory.without_domain() == []


async def test_an_instance_that_waits_for_its_turn_leaves_the_line_for_domains(world: ReconciledServer) -> None:
    matrix = {"parameters": [{"name": "seed", "values": ["1", "2"]}], "parallelism": 1}
    uid = await world.app(components=[component("sim", job={})], matrix=matrix)
    record = world.cache.apps[uid]
    assert record.app is not None
    _, second = record.app.sweep
    world.memory.of(uid).outcomes[second] = DomainOutcome(Reason.DOMAIN_EXHAUSTED, "of a time when more ran at once")
    assert await world.children.reconcile(uid, second)
    assert world.memory.without_domain() == []


async def test_an_id_that_the_cache_shows_free_is_tried_for(world: ReconciledServer) -> None:
    claimed(world, 1)
    uid = await world.app()
    assert await reads(world, uid) > 0
    outcome = world.memory.outcome(uid, "")
    assert outcome is not None
    assert outcome.held


async def test_once_a_claim_is_gone_the_same_instance_gets_its_id(world: ReconciledServer) -> None:
    claimed(world, 1)
    claim = claimed(world, 2)
    uid = await world.app()
    assert await reads(world, uid) == 0
    world.cache.claims.drop("another", claim.name)
    assert await reads(world, uid) > 0
    outcome = world.memory.outcome(uid, "")
    assert outcome is not None
    assert outcome.id == 2


async def test_what_it_holds_already_is_found_by_fresh_reads(world: ReconciledServer) -> None:
    claimed(world, 1)
    uid = await world.app()
    claimed(world, 2, uid=uid)
    assert await reads(world, uid) > 0


@pytest.mark.parametrize("spec", [{"domain": 1}, {"shareWith": [{"name": "other"}]}])
async def test_whoever_asks_for_one_id_or_for_anothers_is_told_afresh(
    world: ReconciledServer, spec: dict[str, Any]
) -> None:
    claimed(world, 1)
    claimed(world, 2)
    uid = await world.app(ros2={"discovery": {"mode": "Multicast"}, **spec})
    assert await reads(world, uid) > 0


@pytest.mark.parametrize(
    ("quota", "reason", "text"),
    [(1, Reason.QUOTA_EXCEEDED, "quota"), (5, Reason.DOMAIN_EXHAUSTED, "2 of 2 domain ids")],
    ids=["used up", "room for more"],
)
async def test_a_namespace_with_a_quota_waits_for_nothing_more(
    world: ReconciledServer, quota: int, reason: Reason, text: str
) -> None:
    """A tenant's apps beyond its quota were read whenever anybody gave an id back."""
    claimed(world, 1)
    claimed(world, 2)
    world.cache.pools["default"] = pool_of(quota=PoolQuota(default=quota))
    uid = await world.app()
    assert await reads(world, uid) == 0
    outcome = world.memory.outcome(uid, "")
    assert outcome is not None
    assert outcome.reason == reason
    assert text in outcome.message


async def test_a_namespace_below_its_quota_tries_for_an_id(world: ReconciledServer) -> None:
    claimed(world, 1)
    world.cache.pools["default"] = pool_of(quota=PoolQuota(default=2))
    assert await reads(world, await world.app()) > 0
