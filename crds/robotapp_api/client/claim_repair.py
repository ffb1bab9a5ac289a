"""Re-create claims that something running stands on; report those that somebody else holds."""

from collections import Counter
from collections.abc import Iterable

from robotapp_api.claims.identity import claim_name
from robotapp_api.claims.objects import Claim, Pod
from robotapp_api.claims.release import is_gone, joined
from robotapp_api.claims.repair import ClaimConflict, Missing, conflicts, missing_claims, runs
from robotapp_api.client.claim_writes import Api, Refused, create_claim, touch
from robotapp_api.client.claims import find_app
from robotapp_api.client.resources import PODS
from robotapp_api.client.sweep_view import find


async def repair(
    client: Api, pods: Iterable[Pod], claims: Iterable[Claim], *, counts: Counter[str]
) -> list[ClaimConflict]:
    """Conflicts that remain. Each pod is read again before a claim is made for it: the listing is seconds old."""
    by_name = {claim.name: claim for claim in claims}
    known = [pod for pod in pods if runs(pod)]
    for name, missing in sorted(missing_claims(known, by_name).items()):
        pod = next(pod for pod in known if any(claim_name(m.spec) == name for m in _needs(pod)))
        current = await find(client, PODS, pod.metadata.name, pod.metadata.namespace, Pod)
        if current is None or is_gone(current, pod.metadata.uid) or not runs(current):
            continue
        if await _only_joins(client, missing):
            continue
        claim = await create_claim(client, missing.spec)
        if claim is None:
            continue  # made meanwhile, by us or by another: the next pass tells a conflict
        counts["Repair"] += 1
        if missing.pod_uid:
            try:
                await touch(client, claim, pod=missing.pod_uid, node=pod.spec.node_name)
            except Refused:
                counts["refused"] += 1
    found = conflicts(known, by_name)
    return [conflict for conflict in found if not await _joins(client, conflict)]


def _needs(pod: Pod) -> Iterable[Missing]:
    return missing_claims((pod,), {}).values()


async def _only_joins(client: Api, missing: Missing) -> bool:
    """An app that shares another one's domain has no claim of its own to lose."""
    holder = missing.spec.holder
    if not (missing.spec.domain and holder.is_app):
        return False
    app = await find_app(client, (holder.namespace, holder.name))
    return app is not None and app.metadata.uid == holder.uid and bool(joined(app))


async def _joins(client: Api, conflict: ClaimConflict) -> bool:
    if not (conflict.runs.is_app and conflict.holds.is_app):
        return False
    app = await find_app(client, (conflict.runs.namespace, conflict.runs.name))
    return app is not None and app.metadata.uid == conflict.runs.uid and bool(joined(app))
