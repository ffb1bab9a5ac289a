"""Re-create claims that something running stands on; report those that somebody else holds."""

from collections import Counter
from collections.abc import Iterable, Mapping

from robotapp_api.claims.identity import claim_name
from robotapp_api.claims.objects import Claim, Holder, Pod
from robotapp_api.claims.release import is_gone, joined
from robotapp_api.claims.repair import ClaimConflict, conflicts, missing_claims, needed_by, runs
from robotapp_api.client.claim_writes import Api, Refused, create_claim, touch
from robotapp_api.client.claims import find_app, resolve_owner
from robotapp_api.client.resources import PODS
from robotapp_api.client.sweep_view import find


async def repair(
    client: Api, pods: Iterable[Pod], claims: Iterable[Claim], *, places: Mapping[str, str], counts: Counter[str]
) -> list[ClaimConflict]:
    """Conflicts that remain. places: zones and nodes, see `places_of`. Each pod is read again before a claim is made for it: the listing is seconds old."""
    by_name = {claim.name: claim for claim in claims}
    known = [pod for pod in pods if runs(pod)]
    for name, missing in sorted(missing_claims(known, by_name, places=places).items()):
        pod = next(pod for pod in known if any(claim_name(m.spec) == name for m in needed_by(pod, places)))
        current = await find(client, PODS, pod.metadata.name, pod.metadata.namespace, Pod)
        if current is None or is_gone(current, pod.metadata.uid) or not runs(current):
            continue
        if missing.spec.domain and await _joins(client, missing.spec.holder):
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
    found = conflicts(known, by_name, places=places)
    domains = {name for name, claim in by_name.items() if claim.spec.domain}
    return [conflict for conflict in found if not (conflict.claim in domains and await _joins(client, conflict.runs))]


async def _joins(client: Api, holder: Holder) -> bool:
    """Whether the app carries another one's domain now: it has no claim of its own to lose, and stands on one of others.

    The app that leads a ring of shareWith owns the domain like any other owner.
    """
    if not holder.is_app:
        return False
    app = await find_app(client, (holder.namespace, holder.name))
    if app is None or app.metadata.uid != holder.uid or not joined(app):
        return False
    return (await resolve_owner(client, app)).owner != (holder.namespace, holder.name)
