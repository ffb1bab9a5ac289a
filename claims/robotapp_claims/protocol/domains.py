"""Domains: the steps of an operator (rule 5), and of a scheduler for a bare pod, with their reads in order."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from robotapp_api.model.names import Label, Reason
from robotapp_claims.protocol.domain_allocation import create_domain, held_outcome
from robotapp_claims.protocol.sweep_snapshot import find
from robotapp_claims.protocol.writes import Api, Refused, note_nodes, touch
from robotapp_claims.rules import domain as rules
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest, Step
from robotapp_claims.rules.identity import same_holder
from robotapp_claims.rules.objects import App, Claim, Deployment, Holder, Job, Pool
from robotapp_claims.rules.pools import refuse_overlap
from robotapp_claims.rules.release import claims_domain
from robotapp_claims.rules.share import AppKey, Join, claim_to_join, owner_of, waiting_text
from robotapp_claims.rules.usage import deployment_ids, usage_of
from robotapp_client.api.resources import DEPLOYMENTS, DOMAINPOOLS, JOBS, ROBOTAPPS, ROBOTCLAIMS

RESTARTS: Final = 5
"""Start over this often within one call when another writer was faster; then the caller's queue backs off."""


async def ensure_domain(
    client: Api,
    request: DomainRequest,
    *,
    app: App | None = None,
    deployments: Sequence[Deployment] | None = None,
    shared_uses: Mapping[int, int] | None = None,
    known_claims: Callable[[], Iterable[Claim]] = tuple,
) -> DomainOutcome:
    """The domain of one app instance: kept, adopted, created, joined, or a value with the reason why there is none.

    app: the holder when the caller has just read it with a quorum; read here otherwise. deployments: the instance's when
    the caller has them (a cache will do: their resourceVersion fences the template write); read here otherwise.
    shared_uses: users per shared id, for isolation Discovery. known_claims: from a cache, see `create_domain`.
    Raises ApiError or Unreachable; a claim whose create got no answer is found and adopted by the next call.
    """
    for _ in range(RESTARTS):
        try:
            return await _ensure_once(
                client, request, app, deployments, shared_uses=shared_uses or {}, known_claims=known_claims
            )
        except Refused:
            app = deployments = None
    return DomainOutcome(Reason.PENDING, "another operator works on this app; trying again")


async def ensure_pod_domain(
    client: Api, request: DomainRequest, *, node: str = "", known_claims: Callable[[], Iterable[Claim]] = tuple
) -> DomainOutcome:
    """The domain of a bare pod (`dds-domain: auto` or a number): adopted or created, or a value with the reason why not.

    Call it between reading the pod and binding it with the resourceVersion that was read; the id is the Binding's grant.
    request.holder is the pod, node where it is about to be bound. Never rolled back: calling again adopts what was created.
    known_claims: from a cache, see `create_domain`.
    Raises ApiError or Unreachable.
    """
    pools = await read_pools(client)
    pool = pools.get(request.pool)
    if pool is None:
        return rules.pool_not_found(request)
    refusal = rules.check_request(request, pool)
    if refusal is not None:
        return refusal
    for _ in range(RESTARTS):
        try:
            return await _own_at(client, request, pools, node, known_claims)
        except Refused:
            continue
    return DomainOutcome(Reason.PENDING, "its claim keeps changing; trying again")


async def _own_at(
    client: Api,
    request: DomainRequest,
    pools: Mapping[str, Pool],
    node: str,
    known_claims: Callable[[], Iterable[Claim]],
) -> DomainOutcome:
    """The pod's own domain, whose claim names the node (if known) before the pod is bound there.

    A claim that was made just now names it from the beginning. No sweep can have read that claim to release it: the pod was there.
    """
    outcome = await _own(client, request, pools, (), known_claims, node=node)
    if node and outcome.held and not outcome.created:
        claim = await find_claim(client, outcome.claim)
        if claim is None or not same_holder(claim.holder, request.holder):
            raise Refused  # freed, and perhaps taken by another, between the two requests
        await note_nodes(client, claim, (node,))
    return outcome


async def _ensure_once(
    client: Api,
    request: DomainRequest,
    app: App | None,
    deployments: Sequence[Deployment] | None,
    *,
    shared_uses: Mapping[int, int],
    known_claims: Callable[[], Iterable[Claim]],
) -> DomainOutcome:
    holder = request.holder
    app = app or await find_app(client, (holder.namespace, holder.name))
    if app is None or app.metadata.uid != holder.uid:
        return DomainOutcome(Reason.PENDING, f"RobotApp {holder.namespace}/{holder.name} is gone", gone=True)
    if deployments is None:
        deployments = await instance_deployments(client, holder)
    join = await resolve_owner(client, app) if request.share_with else Join((holder.namespace, holder.name))
    if join.owner is None:
        return await _without_id(client, request, DomainOutcome(Reason.INVALID_SPEC, join.message), deployments)
    if join.owner != (holder.namespace, holder.name):
        return await _join(client, request, join.owner, deployments)
    pools = await read_pools(client)
    pool = pools.get(request.pool)
    if pool is None:
        return await _without_id(client, request, rules.pool_not_found(request), deployments)
    if request.isolation == "Discovery":
        named = {number for deployment in deployments for number in deployment_ids(deployment)}
        overlap = refuse_overlap(replace(request, requested_id=None), pool, pools.values())
        outcome = rules.shared_id(
            pool, uses=shared_uses, named=named, uid=holder.uid, instance=holder.instance, overlap=overlap
        )
        if outcome.id is None:
            return await _without_id(client, request, outcome, deployments)
        return _without(outcome, deployments, held=(outcome.id,))
    refusal = rules.check_request(request, pool)
    if refusal is not None:
        return await _without_id(client, request, refusal, deployments)
    return await _own(client, request, pools, deployments, known_claims)


async def _own(
    client: Api,
    request: DomainRequest,
    pools: Mapping[str, Pool],
    deployments: Sequence[Deployment],
    known_claims: Callable[[], Iterable[Claim]],
    *,
    node: str = "",
) -> DomainOutcome:
    holder, pool = request.holder, pools[request.pool]
    claims = await instance_claims(client, holder.uid, instance=holder.instance)
    held = rules.held_ids(claims, request, pool.spec.scope)
    plan = rules.plan_domain(
        held={number: not claim.standing for number, claim in held.items()},
        named=[deployment_ids(deployment) for deployment in deployments],
        free=rules.free_ids(pool, claims, request),
        uid=holder.uid,
        instance=holder.instance,
        requested=request.requested_id,
    )
    if plan.id is None:
        outcome = await create_domain(
            client, request, pool, plan, pools=pools.values(), known_claims=known_claims, node=node
        )
    else:
        claim = held[plan.id]
        if plan.step is Step.ADOPT:
            await touch(client, claim)
        outcome = held_outcome(claim)
    if outcome.id is None:
        return await _without_id(client, request, outcome, deployments)
    return _without(outcome, deployments, held=(outcome.id,))


def _without(outcome: DomainOutcome, deployments: Sequence[Deployment], *, held: Iterable[int]) -> DomainOutcome:
    """The outcome with what the caller's template writes need."""
    return replace(
        outcome,
        fences=rules.fences_of(deployments),
        unheld=rules.naming_unheld(deployments, set(held)),
    )


async def _without_id(
    client: Api, request: DomainRequest, outcome: DomainOutcome, deployments: Sequence[Deployment]
) -> DomainOutcome:
    """No id is available as the spec requests it. What the instance holds all the same, of whatever pool, its pods may keep."""
    if not deployments:
        return outcome  # nothing names an id, held or not
    claims = await instance_claims(client, request.holder.uid, instance=request.holder.instance)
    held = {claim.spec.domain.id for claim in claims if claim.spec.domain and same_holder(claim.holder, request.holder)}
    return _without(outcome, deployments, held=held)


async def _join(client: Api, request: DomainRequest, owner: AppKey, deployments: Sequence[Deployment]) -> DomainOutcome:
    """shareWith: carry the id that the owner's instance wants and holds; wait while it has none."""
    named = "/".join(owner)
    app = await find_app(client, owner)
    if app is not None and not claims_domain(app):
        text = f"spec.ros2.shareWith names {named}, which claims no domain (ROS 1, no ROS, or isolation Discovery): remove it"
        return await _without_id(client, request, DomainOutcome(Reason.INVALID_SPEC, text), deployments)
    claim, claims = None, list[Claim]()
    if app is not None:
        theirs = usage_of(deployments=await app_deployments(client, app), jobs=await app_jobs(client, app))
        claims = await instance_claims(client, app.metadata.uid)
        named_ids_of = theirs.named_by_instance(app.metadata.namespace, app.metadata.uid)
        claim = claim_to_join(app, request.holder.instance, claims, named=named_ids_of)
    if claim is None or not claim.standing:
        text = waiting_text(named, request.holder.instance, {claim.holder.instance for claim in claims})
        if claim is None or claim.spec.domain is None:
            return await _without_id(client, request, DomainOutcome(Reason.PENDING, text), deployments)
        return _without(DomainOutcome(Reason.PENDING, text), deployments, held=(claim.spec.domain.id,))
    outcome = held_outcome(claim)
    shared = replace(outcome, message=f"{outcome.message}, shared with {named}")
    return _without(shared, deployments, held=() if shared.id is None else (shared.id,))


# Reads


async def find_app(client: Api, key: AppKey) -> App | None:
    return await find(client, ROBOTAPPS, key[1], key[0], App)


async def find_claim(client: Api, name: str) -> Claim | None:
    return await find(client, ROBOTCLAIMS, name, "", Claim)


async def find_pool(client: Api, name: str) -> Pool | None:
    return await find(client, DOMAINPOOLS, name, "", Pool)


async def read_pools(client: Api) -> dict[str, Pool]:
    """All pools by name: one alone does not show whether it may give an id."""
    return {pool.metadata.name: pool for pool in (await client.list(DOMAINPOOLS, as_type=Pool)).items}


async def instance_deployments(client: Api, holder: Holder) -> list[Deployment]:
    """Returns the instance's Deployments, and as such its Jobs that have not ended: their templates name domains alike."""
    selector = f"{Label.APP_UID}={holder.uid},{Label.INSTANCE}={holder.instance}"
    listing = await client.list(DEPLOYMENTS, namespace=holder.namespace, label_selector=selector, as_type=Deployment)
    jobs = await client.list(JOBS, namespace=holder.namespace, label_selector=selector, as_type=Job)
    unfinished = (job for job in jobs.items if job.status.verdict is None)
    return [*listing.items, *(Deployment(metadata=job.metadata, spec=job.spec) for job in unfinished)]


async def app_deployments(client: Api, app: App) -> list[Deployment]:
    """Deployments of all instances of an app."""
    meta = app.metadata
    selector = f"{Label.APP_UID}={meta.uid}"
    return (await client.list(DEPLOYMENTS, namespace=meta.namespace, label_selector=selector, as_type=Deployment)).items


async def app_jobs(client: Api, app: App) -> list[Job]:
    """Returns the Jobs of all instances of an app."""
    meta = app.metadata
    selector = f"{Label.APP_UID}={meta.uid}"
    return (await client.list(JOBS, namespace=meta.namespace, label_selector=selector, as_type=Job)).items


async def instance_claims(client: Api, uid: str, *, instance: str | None = None) -> list[Claim]:
    """Domain claims of an app or of one instance. By spec fields: labels of a claim can be changed, its spec cannot."""
    selector = f"spec.holder.uid={uid}"
    if instance is not None:
        selector += f",spec.holder.instance={instance}"
    listing = await client.list(ROBOTCLAIMS, field_selector=selector, as_type=Claim)
    return [claim for claim in listing.items if claim.spec.domain is not None]


async def resolve_owner(client: Api, app: App) -> Join:
    """Read the apps that shareWith leads to, then decide."""
    known: dict[AppKey, App | None] = {(app.metadata.namespace, app.metadata.name): app}
    while True:
        wanted: list[AppKey] = []

        def lookup(key: AppKey, wanted: list[AppKey] = wanted) -> App | None:
            if key not in known:
                wanted.append(key)
            return known.get(key)

        join = owner_of(app, lookup)
        if not wanted:
            return join
        for key in wanted:
            known[key] = await find_app(client, key)
