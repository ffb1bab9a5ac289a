"""The bind check (rule 1 of claims.md): a pod whose template names a domain is bound only while its app holds the claim."""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Final

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.quantities.ranges import parse_ids
from robotapp_claims.protocol.domains import RESTARTS, find_app, find_claim, find_pool, instance_claims, resolve_owner
from robotapp_claims.protocol.writes import Api, Refused, note_nodes
from robotapp_claims.rules.bind import ALLOWED, BindVerdict, bind_verdict, needs_check, shared_verdict
from robotapp_claims.rules.objects import App, Claim, Pod
from robotapp_claims.rules.release import joined
from robotapp_claims.rules.usage import named_ids
from robotapp_client.api.parallelize import at_once

KEEPS_CHANGING: Final = BindVerdict(False, "the claim of its domain keeps changing; trying again")


async def check_bind(client: Api, pod: Pod) -> BindVerdict:
    """Rule 1 for one pod. Call it after the pod was seen pending; bind with the pod's uid at once when allowed."""
    return (await check_bind_all(client, (pod,)))[0]


async def check_bind_all(client: Api, pods: Sequence[Pod], *, nodes: Sequence[str] = ()) -> list[BindVerdict]:
    """Rule 1 for pods that were all seen pending before this call: one read per claim, not per pod.

    nodes: the node each pod is about to be bound to, which is written to its claim; empty when another scheduler decides.
    """
    going = {pod.metadata.uid: node for pod, node in zip(pods, nodes, strict=bool(nodes))}
    verdicts: dict[str, BindVerdict] = {}
    left = list(pods)
    for _ in range(RESTARTS):
        left = await _check_and_note(client, left, going, verdicts)
        if not left:
            break
    return [verdicts.get(pod.metadata.uid, KEEPS_CHANGING) for pod in pods]


async def _check_and_note(
    client: Api, pods: Collection[Pod], going: Mapping[str, str], verdicts: dict[str, BindVerdict]
) -> list[Pod]:
    """Fill `verdicts`. Returns the pods whose claim changed before their node could be written into it."""
    read = await _read_claims(client, pods)
    allowed: dict[str, list[Pod]] = defaultdict(list)
    for pod in pods:
        verdict, claim = await _check(client, pod, read)
        if verdict.allowed and claim is not None and pod.metadata.uid in going:
            read[claim.name] = claim
            allowed[claim.name].append(pod)
        else:
            verdicts[pod.metadata.uid] = verdict

    async def note(name: str) -> list[Pod]:
        """Write the nodes of a claim's pods into it. Returns these pods when the claim has changed, so that they are checked again."""
        found, claim = allowed[name], read[name]
        try:
            if claim is not None:
                await note_nodes(client, claim, {going[pod.metadata.uid] for pod in found})
        except Refused:
            return found
        verdicts.update({pod.metadata.uid: ALLOWED for pod in found})
        return []

    return list(chain.from_iterable(await at_once(note, allowed)))


async def _read_claims(client: Api, pods: Collection[Pod]) -> dict[str, Claim | None]:
    """The claims that the pods' annotations name, by name; None where there is none."""
    named = (pod.metadata.annotations.get(Annotation.DOMAIN_CLAIM, "") for pod in pods if needs_check(pod))
    names = sorted({*named} - {""})
    return dict(zip(names, await at_once(partial(find_claim, client), names), strict=True))


async def _check(client: Api, pod: Pod, read: dict[str, Claim | None]) -> tuple[BindVerdict, Claim | None]:
    """The verdict on one pod, and the claim that allows it. read: the claims that annotations name, by name."""
    if not needs_check(pod):
        return ALLOWED, None
    name = pod.metadata.annotations.get(Annotation.DOMAIN_CLAIM, "")
    if not name:
        return await _check_without_annotation(client, pod)
    claim = read[name]
    verdict = bind_verdict(pod, claim)
    if not verdict.allowed and claim is not None and await _shares(client, pod, claim):
        verdict = bind_verdict(pod, claim, sharing=(claim.holder.uid,))
    return verdict, claim


async def _check_without_annotation(client: Api, pod: Pod) -> tuple[BindVerdict, Claim | None]:
    claims = await instance_claims(client, pod.metadata.app_uid, instance=pod.metadata.instance)
    ids = named_ids(pod.spec)
    match = [claim for claim in claims if claim.spec.domain and {claim.spec.domain.id} == ids]
    standing = [claim for claim in match if claim.standing]
    claim = next(iter(standing or match), None)
    verdict = bind_verdict(pod, claim)
    if match:
        return verdict, claim
    app = await _app_of(client, pod)
    if app is None or app.spec.ros2 is None or app.spec.ros2.isolation != "Discovery":
        return verdict, None
    pool = await find_pool(client, app.spec.ros2.pool)
    return (verdict if pool is None else shared_verdict(pod, parse_ids(pool.spec.shared_ids))), None


async def _app_of(client: Api, pod: Pod) -> App | None:
    name = pod.metadata.labels.get(Label.APP, "")
    app = await find_app(client, (pod.metadata.namespace, name)) if name else None
    return app if app is not None and app.metadata.uid == pod.metadata.app_uid else None


async def _shares(client: Api, pod: Pod, claim: Claim) -> bool:
    """Whether the specs of both apps let the pod's app join the holder's domain (shareWith)."""
    holder = claim.holder
    if not holder.is_app or holder.uid == pod.metadata.app_uid:
        return False
    app = await _app_of(client, pod)
    if app is None or not joined(app):
        return False
    join = await resolve_owner(client, app)
    return join.owner == (holder.namespace, holder.name)
