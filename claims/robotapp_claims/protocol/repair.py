"""Re-create claims that something running stands on; report those that another app holds.

Labels say what a pod stands on, and any user may write them. So nothing is made or reported for a pod of an app before its
owners have led to an app that exists, and no claim is made that the app could not have had from its pool.
"""

import logging
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress

from robotapp_api.model.names import Label
from robotapp_claims.protocol.domain_allocation import pool_claims, turn
from robotapp_claims.protocol.domains import resolve_owner
from robotapp_claims.protocol.errors import Troubles
from robotapp_claims.protocol.sweep_snapshot import View, find
from robotapp_claims.protocol.writes import Api, Refused, create_claim, note_nodes, touch
from robotapp_claims.rules import domain as rules
from robotapp_claims.rules.domain import DomainRequest
from robotapp_claims.rules.identity import claim_name, same_holder
from robotapp_claims.rules.objects import App, Claim, Pod, Pool
from robotapp_claims.rules.release import is_gone, joined
from robotapp_claims.rules.repair import (
    ClaimConflict,
    Missing,
    conflicts,
    lost_grant,
    missing_claims,
    needed_by,
    refusal,
    runs,
)
from robotapp_client.api.resources import DOMAINPOOLS, PODS, ROBOTCLAIMS
from robotapp_client.transport.errors import ClientError

log = logging.getLogger(__name__)


async def make_lost_claims(client: Api, known: Iterable[Claim]) -> int:
    """Makes claims again that were granted after the snapshot from which etcd was restored. Returns how many.

    known: what our cache showed before. Without such a claim its id could be granted at once, while containers of the lost
    app still run. A holder that exists keeps what it had; of one that is lost, too, the sweep lets the claim rest and deletes it.
    """
    count = 0
    try:
        stored = {claim.name: claim for claim in (await client.list(ROBOTCLAIMS, as_type=Claim)).items}
        for claim in sorted(known, key=lambda claim: claim.name):
            count += await _make_again(client, claim, stored.get(claim.name))
    except ClientError as error:
        log.error("claims granted after the restored snapshot could not all be made again: %s", error)  # noqa: TRY400
    level = logging.WARNING if count else logging.INFO
    log.log(level, "claims granted after the restored snapshot: %d are made again", count)
    return count


async def _make_again(client: Api, known_claim: Claim, claim: Claim | None) -> bool:
    """Stores again what of a claim was lost, and returns whether it did. It does not when somebody has got the thing meanwhile."""
    lost = lost_grant(known_claim, claim)
    if lost.create:
        claim = await create_claim(client, known_claim.spec, node=lost.nodes[0] if lost.nodes else "")
    elif not lost.nodes:
        return False
    if claim is None:
        return False
    if not {*lost.nodes} <= {*claim.nodes}:
        with suppress(Refused):  # its holder was quicker
            await note_nodes(client, claim, lost.nodes)
    return True


async def repair(view: View, pods: Iterable[Pod], counts: Counter[str], troubles: Troubles) -> list[ClaimConflict]:
    """Conflicts that remain. pods: those of the view and, with their grants, bare ones.

    Each pod is read again before a claim is made for it: the listing is seconds old.
    """
    known = [pod for pod in pods if runs(pod) and _owned(view, pod)]
    places = await view.places(known)
    for name, missing in sorted(missing_claims(known, view.known, places=places).items()):
        with troubles.of(name):
            pod = next(pod for pod in known if any(claim_name(m.spec) == name for m in needed_by(pod, places)))
            if await _restore(view, pod, missing):
                counts["Repair"] += 1
    found = []
    for conflict in conflicts(known, view.known, places=places):
        with troubles.of(conflict.claim):
            if await _stands(view, conflict):
                found.append(conflict)
    return found


def _owned(view: View, pod: Pod) -> bool:
    """A bare pod holds by itself and by grants that only our scheduler gives; one of an app needs its owners."""
    meta = pod.metadata
    if not meta.app_uid:
        return True
    app = view.usage.owners.app_of(meta)
    return app is not None and app.name == meta.labels.get(Label.APP)


async def _restore(view: View, pod: Pod, missing: Missing) -> bool:
    """Whether the claim was made again."""
    meta = pod.metadata
    current = await find(view.client, PODS, meta.name, meta.namespace, Pod)
    if current is None or is_gone(current, meta.uid) or not runs(current):
        return False
    claim = await (_for_app(view, missing) if missing.spec.holder.is_app else create_claim(view.client, missing.spec))
    if claim is None:
        return False  # made meanwhile, by us or by another: the next pass reports a conflict
    if missing.pod_uid:
        await touch(view.client, claim, pod=missing.pod_uid, node=pod.spec.node_name)
    return True


async def _for_app(view: View, missing: Missing) -> Claim | None:
    holder, domain = missing.spec.holder, missing.spec.domain
    app = await view.app(holder)
    if app is None or (domain and await _joins(view, app)):
        return None
    if domain is None:
        return (
            None if _not_made(missing, refusal(missing, app, None)) else await create_claim(view.client, missing.spec)
        )
    async with turn(domain.pool, holder.namespace):
        pool = await find(view.client, DOMAINPOOLS, domain.pool, "", Pool)
        why = refusal(missing, app, pool)
        if pool is not None and not why:
            request = DomainRequest(holder, pool=domain.pool, scope_value=domain.scope_value, requested_id=domain.id)
            held = sum(c.holder.namespace == holder.namespace for c in await pool_claims(view.client, request))
            outcome = rules.check_request(request, pool) or rules.over_quota(request, pool, held=held)
            why = outcome.message if outcome else ""
        return None if _not_made(missing, why) else await create_claim(view.client, missing.spec)


def _not_made(missing: Missing, why: str) -> bool:
    if why:
        holder_name = f"{missing.spec.holder.namespace}/{missing.spec.holder.name}"
        log.warning(
            "claim %s is not made again for the running pods of %s: %s", claim_name(missing.spec), holder_name, why
        )
    return bool(why)


async def _stands(view: View, conflict: ClaimConflict) -> bool:
    """Whether it is so now, the running pod belongs to that app, and does not share the domain on purpose."""
    if not await _is_so(view, conflict):
        return False
    if not conflict.runs.is_app:
        return True
    app = await view.app(conflict.runs)
    if app is None:
        return False
    return view.known[conflict.claim].spec.domain is None or not await _joins(view, app)


async def _is_so(view: View, conflict: ClaimConflict) -> bool:
    """Bare pods come from a cache, where one may run that is long gone, and a claim changes hands between two listings."""
    if not conflict.runs.is_app:
        pod = await view.holder_pod(conflict.runs)
        if pod is None or not runs(pod):
            return False
    claim = await find(view.client, ROBOTCLAIMS, conflict.claim, "", Claim)
    return claim is not None and same_holder(claim.holder, conflict.holds)


async def _joins(view: View, app: App) -> bool:
    """Whether the app carries another one's domain now: it has no claim of its own to lose, and stands on one of others.

    The app that leads a ring of shareWith owns the domain like any other owner.
    """
    meta = app.metadata
    return bool(joined(app)) and (await resolve_owner(view.client, app)).owner != (meta.namespace, meta.name)
