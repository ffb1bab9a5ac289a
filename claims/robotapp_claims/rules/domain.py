"""Rules 4 and 5: which domain id an app instance has, adopts or tries to create."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from robotapp_api.model.names import SAFE_IDS, Annotation, Reason
from robotapp_api.values.quantities.ranges import is_safe_id, parse_ids
from robotapp_claims.rules.identity import domain_spec, holder_text, id_order, same_holder
from robotapp_claims.rules.objects import Claim, ClaimSpec, Deployment, Holder, Pool
from robotapp_claims.rules.usage import deployment_ids


@dataclass(frozen=True, slots=True)
class DomainRequest:
    """What an app instance requests.

    holder: the RobotApp with `instance` set. scope_value: zone or node for pools of that scope, else empty.
    requested_id: `ros2.domain` or a bare pod's number, None means any. share_with: (namespace, name) of the RobotApps whose
    domain is joined. allow_unsafe: `ros2.allowUnsafeDomain`, which a bare pod cannot write.
    """

    holder: Holder
    pool: str = "default"
    scope_value: str = ""
    requested_id: int | None = None
    isolation: str = "Domain"
    share_with: tuple[tuple[str, str], ...] = ()
    allow_unsafe: bool = False


@dataclass(frozen=True, slots=True)
class Fence:
    """The Deployment as it was before the claims were read: the template write must carry both."""

    uid: str
    resource_version: str


@dataclass(frozen=True, slots=True)
class DomainOutcome:
    """The id an instance may write into its templates, or why it has none.

    fences: what the template write of each existing Deployment must carry; a Deployment that is missing is created.
    unheld: Deployments that name an id the instance does not hold: rewritten, or scaled to 0 while there is no id.
    gone: the RobotApp no longer exists with this uid: write nothing at all, a late write would re-own an orphan.
    created: the claim is new (worth an event); False when it was held before.
    """

    reason: Reason
    message: str
    id: int | None = None
    claim: str = ""
    fences: Mapping[str, Fence] = field(default_factory=dict)
    unheld: tuple[str, ...] = ()
    gone: bool = False
    created: bool = False

    @property
    def held(self) -> bool:
        return self.id is not None


class Step(StrEnum):
    KEEP = "Keep"
    """Held, and every Deployment names it: nothing to write."""
    ADOPT = "Adopt"
    """Held: touch the claim (compare-and-swap), then write the template."""
    CREATE = "Create"
    """Nothing held: create the first candidate that is free."""


@dataclass(frozen=True, slots=True)
class DomainPlan:
    step: Step
    id: int | None = None
    candidates: tuple[int, ...] = ()


def wanted_id(
    *, held: Collection[int], named: Collection[int], uid: str, instance: str, requested: int | None
) -> int | None:
    """Rule 4: the held id that a Deployment names, else the first held one in hash order; None when none is held.

    Operators and sweeps get the same answer from the same state, so an instance settles on one id.
    """
    acceptable = [number for number in id_order(held, uid, instance) if requested in (None, number)]
    return next((number for number in acceptable if number in named), acceptable[0] if acceptable else None)


def plan_domain(
    *,
    held: Mapping[int, bool],
    named: Sequence[Collection[int]],
    free: Collection[int],
    uid: str,
    instance: str,
    requested: int | None,
) -> DomainPlan:
    """Rule 5 after the LIST. held: id -> is being given back or parked. named: ids each Deployment names. free: ids the pool hands out.

    A named id that is not held is tried first: after a claim was deleted by hand the pods need not move.
    """
    everything = {number for ids in named for number in ids}
    wanted = wanted_id(held=held, named=everything, uid=uid, instance=instance, requested=requested)
    if wanted is None:
        order = id_order(free, uid, instance)
        first = [number for number in order if number in everything]
        rest = [number for number in order if number not in everything]
        return DomainPlan(Step.CREATE, candidates=(requested,) if requested is not None else (*first, *rest))
    settled = bool(named) and all(set(ids) == {wanted} for ids in named) and not held[wanted]
    return DomainPlan(Step.KEEP if settled else Step.ADOPT, id=wanted)


def held_ids(claims: Iterable[Claim], request: DomainRequest, scope: str) -> dict[int, Claim]:
    """Claims of this instance in this pool and scope, by id. The others leave through the sweep."""
    return {
        claim.spec.domain.id: claim
        for claim in claims
        if claim.spec.domain is not None
        and same_holder(claim.holder, request.holder)
        and (claim.spec.domain.pool, claim.spec.domain.scope) == (request.pool, scope)
        and claim.spec.domain.scope_value == request.scope_value
    }


def pool_ids(pool: Pool) -> frozenset[int]:
    """Ids the pool hands out by itself: claimed exclusively, not shared, not reserved."""
    shared = frozenset(parse_ids(pool.spec.shared_ids))
    return frozenset(parse_ids(pool.spec.ids)) - shared - frozenset(pool.spec.reserved)


def free_ids(pool: Pool, claims: Iterable[Claim], request: DomainRequest) -> frozenset[int]:
    """Candidates: an id the instance still holds elsewhere is left out, because the literal alone distinguishes them."""
    elsewhere = {
        claim.spec.domain.id for claim in claims if claim.spec.domain and same_holder(claim.holder, request.holder)
    }
    return pool_ids(pool) - elsewhere


def spec_for(request: DomainRequest, scope: str, domain_id: int) -> ClaimSpec:
    return domain_spec(
        pool=request.pool,
        scope=scope,
        scope_value=request.scope_value,
        domain_id=domain_id,
        holder=request.holder,
    )


def fences_of(deployments: Iterable[Deployment]) -> dict[str, Fence]:
    return {d.metadata.name: Fence(d.metadata.uid, d.metadata.resource_version) for d in deployments}


def naming_unheld(deployments: Iterable[Deployment], held: Collection[int]) -> tuple[str, ...]:
    """Deployments whose template names an id that is not held. A late one could start pods that may never bind."""
    return tuple(sorted(d.metadata.name for d in deployments if deployment_ids(d) - set(held)))


# Refusals: values with what to do


def check_request(request: DomainRequest, pool: Pool) -> DomainOutcome | None:
    """What is wrong with asking this pool, before anything is read."""
    scope = pool.spec.scope
    if scope != "Cluster" and not request.scope_value:
        return DomainOutcome(
            Reason.INVALID_SPEC,
            f"pool {request.pool} hands out ids per {scope.lower()}, and this app has no single {scope.lower()}: "
            f"give it spec.robots, one entry in spec.placement.zones, or a pool of scope Cluster",
        )
    if request.requested_id is not None and request.requested_id in parse_ids(pool.spec.shared_ids):
        join = " or set spec.ros2.isolation: Discovery" if request.holder.is_app else ""
        return DomainOutcome(
            Reason.DOMAIN_TAKEN,
            f"domain {request.requested_id} is one of the shared ids of pool {request.pool} ({pool.spec.shared_ids}), "
            f"which apps with isolation Discovery use together: choose another id{join}",
        )
    return None


def withheld(request: DomainRequest, pool: Pool) -> DomainOutcome | None:
    """Why the requested id is given to no holder, whether it is free or not; None when it may be claimed.

    For new claims only: an id that was claimed before the pool reserved it stays with its holder, whose robots drive.
    """
    number = request.requested_id
    if number is None:
        return None
    cure = _for_a_free_one(request)
    if number in pool.spec.reserved:
        return DomainOutcome(
            Reason.INVALID_SPEC,
            f"domain {number} is reserved in pool {request.pool}, so nobody gets it: {cure} to get a free one, or choose a "
            f"number that spec.reserved of DomainPool {request.pool} does not name",
        )
    if is_safe_id(number) or request.allow_unsafe or number in pool_ids(pool):
        return None
    allow = ", or write spec.ros2.allowUnsafeDomain: true" if request.holder.is_app else ""
    return DomainOutcome(
        Reason.INVALID_SPEC,
        f"domain {number} is unsafe, because 0 is everybody's default and 102-214 meet Linux ephemeral ports: {cure} to get "
        f"a free one, or choose one of {SAFE_IDS}{allow}",
    )


def _for_a_free_one(request: DomainRequest) -> str:
    """What the holder writes to be given any free id. A bare pod has an annotation, and no spec of ours."""
    return (
        "leave spec.ros2.domain out"
        if request.holder.is_app
        else f'write "auto" in the annotation {Annotation.DDS_DOMAIN}'
    )


def pool_not_found(request: DomainRequest) -> DomainOutcome:
    choose = ", or choose one of `kubectl get domainpools` in spec.ros2.pool" if request.holder.is_app else ""
    return DomainOutcome(Reason.POOL_NOT_FOUND, f"there is no DomainPool {request.pool}: create it{choose}")


def exhausted(
    request: DomainRequest, pool: Pool, *, claimed: int, resting: int, parked: int = 0, elsewhere: int = 0
) -> DomainOutcome:
    """To a bare pod without what changes from moment to moment: each attempt would be another event and another condition.

    elsewhere: ids of the pool that others hold through other pools of its network.
    """
    rest = f", {resting} of them resting up to {pool.spec.quarantine_seconds} s after use" if resting else ""
    rest += f", {parked} of them parked for robots out of sight" if parked else ""
    rest += f", {elsewhere} more are held through other pools of its network" if elsewhere else ""
    rest = rest if request.holder.is_app else ""
    total = len(pool_ids(pool))
    another = ", or use another pool (spec.ros2.pool)" if request.holder.is_app else ""
    return DomainOutcome(
        Reason.DOMAIN_EXHAUSTED,
        f"{claimed} of {total} domain ids of pool {request.pool} are claimed{rest}: delete an app that is "
        f"no longer needed, add ids to DomainPool {request.pool}{another}",
    )


def taken(request: DomainRequest, holder: Holder) -> DomainOutcome:
    holder_name = holder_text(holder, for_namespace=request.holder.namespace)
    join = "join on purpose with spec.ros2.shareWith, " if request.holder.is_app else ""
    return DomainOutcome(
        Reason.DOMAIN_TAKEN,
        f"domain {request.requested_id} of pool {request.pool} is held by {holder_name}: {_for_a_free_one(request)} to get a "
        f"free one, {join}or delete the holder",
    )


def quota_of(pool: Pool, namespace: str) -> int | None:
    """Ids the namespace may hold: 0 is none, None is no limit."""
    return pool.spec.quota.namespaces.get(namespace, pool.spec.quota.default)


def count_available(pool: Pool, namespace: str) -> int:
    """Returns how many ids of the pool the namespace may hold, if nobody else holds any."""
    limit, total = quota_of(pool, namespace), len(pool_ids(pool))
    return total if limit is None else min(limit, total)


def over_quota(request: DomainRequest, pool: Pool, *, held: int) -> DomainOutcome | None:
    namespace = request.holder.namespace
    limit = quota_of(pool, namespace)
    if limit is None or held < limit:
        return None
    if limit == 0:
        where = f"quota.namespaces.{namespace}" if namespace in pool.spec.quota.namespaces else "quota.default"
        another = "use another pool (spec.ros2.pool), or " if request.holder.is_app else ""
        text = (
            f"pool {request.pool} gives namespace {namespace} 0 domain ids (spec.{where}): {another}"
            f"ask for a quota above 0 in DomainPool {request.pool}; without a quota it is unlimited"
        )
    else:
        text = (
            f"namespace {namespace} holds {held} of the {limit} domain ids pool {request.pool} allows it: "
            f"delete an app there, or ask for a higher quota in DomainPool {request.pool}"
        )
    return DomainOutcome(Reason.QUOTA_EXCEEDED, text)


def shared_id(
    pool: Pool,
    *,
    uses: Mapping[int, int],
    named: Collection[int],
    uid: str,
    instance: str,
    overlap: DomainOutcome | None = None,
) -> DomainOutcome:
    """Isolation Discovery: no claim; stay on the shared id in use, else take the one with the fewest users.

    An id that became reserved while it is in use stays with the apps that use it: to move them would restart their pods.
    overlap: why the pool gives no id anew.
    """
    every = id_order(parse_ids(pool.spec.shared_ids), uid, instance)
    stay = next((number for number in every if number in named), None)
    ids = [number for number in every if number not in pool.spec.reserved]
    if stay is None and overlap is not None:
        return overlap
    if stay is None and not ids:
        return DomainOutcome(
            Reason.DOMAIN_EXHAUSTED,
            f"pool {pool.metadata.name} has no sharedIds for isolation Discovery that are not reserved: add some, for "
            f"example 90-101 (and take them out of ids), or use spec.ros2.isolation: Domain",
        )
    chosen = stay if stay is not None else min(ids, key=lambda number: uses.get(number, 0))
    return DomainOutcome(Reason.ALLOCATED, f"domain {chosen} is shared; discovery keeps apps apart", id=chosen)
