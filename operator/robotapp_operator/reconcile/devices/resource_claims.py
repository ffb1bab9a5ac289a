"""Creates and deletes the ResourceClaims of components. Who gets which device is written by schedulers alone."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

import msgspec

from robotapp_api.model.names import Annotation, Label, Reason
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_client import AlreadyExists, ApiClient, ApiError, Conflict, NotFound
from robotapp_client.api.resources import RESOURCECLAIMS
from robotapp_operator.plan.render.devices.resource_claim import DeviceClaim, named_claim
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Deployment, Job, Pod
from robotapp_operator.plan.status.components import over_quota
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.apply_plan import evict
from robotapp_operator.watch.cache import Cache

log = logging.getLogger(__name__)


class ClaimOwner(Protocol):
    """The app that controls claims; its spec may be unreadable."""

    @property
    def uid(self) -> str: ...
    @property
    def namespace(self) -> str: ...


class ClaimPlan(NamedTuple):
    """ResourceClaims to create and to delete. `deletes`: claims that nobody may use any more, and those whose wish has changed."""

    creates: tuple[DeviceClaim, ...] = ()
    deletes: tuple[ResourceClaim, ...] = ()


def plan_claims(
    app: ClaimOwner,
    wanted: Sequence[DeviceClaim],
    observed: Iterable[ResourceClaim],
    *,
    workloads: Iterable[Deployment | Job],
    pods: Iterable[Pod],
) -> ClaimPlan:
    """Returns the ResourceClaims of one instance to create and to delete.

    A claim that is not wanted stays while a pod of its component exists, or a Deployment or Job may still make one: the device is in use. The
    spec of a claim never changes, so another wish is another claim of the same name; the driver refuses a device that the pod of the
    former claim still has.
    """
    claims_by_name = {
        claim.metadata.name: claim
        for claim in observed
        if claim.metadata.controller_uid == app.uid and claim.metadata.namespace == app.namespace
    }
    claim_names = {
        named_claim(item.spec) for item in workloads if (item.may_run if isinstance(item, Job) else item.replicas)
    }
    component_names = {pod.metadata.labels.get(Label.COMPONENT, "") for pod in pods if not pod.terminal}
    creates: list[DeviceClaim] = []
    deletes: list[ResourceClaim] = []
    for wish in wanted:
        over = claims_by_name.pop(wish.name, None)
        if over is None or over.metadata.annotations.get(Annotation.CONTENT_HASH) != wish.hash:
            creates.append(wish)
            deletes += [over] if over is not None else []
    for name, claim in sorted(claims_by_name.items()):
        is_free = name not in claim_names and claim.metadata.labels.get(Label.COMPONENT, "") not in component_names
        if is_free and claim.metadata.deletion_timestamp is None:
            deletes.append(claim)
    return ClaimPlan(tuple(creates), tuple(deletes))


async def write_claims(client: ApiClient, app: App, plan: ClaimPlan) -> list[tuple[Reason, str]]:
    """Deletes, then creates. Returns why claims were refused. Raises StartOver where an old claim of a name is not gone yet."""
    await release_unused(client, plan.deletes)
    refusals = []
    for claim in plan.creates:
        try:
            await client.create(RESOURCECLAIMS, claim.body(app), namespace=app.namespace)
        except AlreadyExists:
            refusals += await _explain_conflict(client, app, claim)
        except ApiError as error:
            reason = Reason.QUOTA_REFUSED if over_quota(error.message) else Reason.FAILED_CREATE
            refusals.append((reason, f"ResourceClaim {claim.name}: {error.message}"[:1024]))
    return refusals


async def release_unused(client: ApiClient, resource_claims: Iterable[ResourceClaim]) -> None:
    """Deletes claims that are to go. Raises StartOver when one was written meanwhile: a pod may use it by now."""
    if not await release_claims(client, resource_claims):
        raise StartOver("a ResourceClaim changed before it was deleted")


async def release_claims(client: ApiClient, resource_claims: Iterable[ResourceClaim]) -> bool:
    """Deletes claims on which nobody has written since they were read, so that their devices are free. Returns whether all are gone."""
    are_gone = True
    for resource_claim in resource_claims:
        meta = resource_claim.metadata
        try:
            await client.delete(
                RESOURCECLAIMS,
                meta.name,
                namespace=meta.namespace,
                uid=meta.uid,
                resource_version=meta.resource_version,
            )
        except NotFound:
            log.debug("ResourceClaim %s is gone already", meta.name)
        except Conflict:
            log.info("ResourceClaim %s/%s stays: it was written meanwhile", meta.namespace, meta.name)
            are_gone = False
    return are_gone


async def give_back(client: ApiClient, cache: Cache, pod: Pod) -> None:
    """Replaces a pod that cannot have its device, and the claim whose device another one keeps: its successor has one that is free.

    A claim that was made anew, after somebody deleted it below the pod, is the successor's. Two schedulers may give one device to two claims; the driver hands it to the first. The pod goes before the claim, in the state in
    which it was seen to wait: one that got its device meanwhile, or was replaced, keeps its claim. The claim goes in the state in which
    it was seen, too: where the next pod has joined it before, it stays until the driver has refused that pod as long. Who may have the
    device meanwhile is decided by the driver's lock.
    """
    meta = pod.metadata
    claims = cache.allocations.claims.of_instance(meta.app_uid, meta.instance).values()
    pod_claims = [
        claim
        for claim in claims
        if claim.metadata.controller_uid == meta.app_uid
        and claim.metadata.namespace == meta.namespace
        and any(user.uid == meta.uid for user in claim.status.reserved_for)
    ]
    if not pod_claims and not cache.allocations.lacks_its_claim(pod):
        return
    if await evict(client, pod, version=meta.resource_version) != "":
        return
    subject = "pod and claim are" if pod_claims else "its claim was made anew, and now the pod is"
    log.info("pod %s/%s cannot have its device: %s made anew", meta.namespace, meta.name, subject)
    await release_claims(client, pod_claims)


async def _explain_conflict(client: ApiClient, app: App, claim: DeviceClaim) -> list[tuple[Reason, str]]:
    """Returns nothing for a claim of the app's own that the cache did not show yet."""
    try:
        live = msgspec.convert(await client.get(RESOURCECLAIMS, claim.name, namespace=app.namespace), ResourceClaim)
    except NotFound as race:
        raise StartOver(str(race)) from race
    meta = live.metadata
    if meta.controller_uid != app.uid:
        text = f"ResourceClaim {claim.name} exists and belongs to somebody else; delete or rename it"
        return [(Reason.FAILED_CREATE, text)]
    if meta.deletion_timestamp is not None or meta.annotations.get(Annotation.CONTENT_HASH) != claim.hash:
        raise StartOver(f"the former ResourceClaim {claim.name} is still there")
    return []


def components_with_pods(pods: Mapping[str, Sequence[Pod]]) -> frozenset[str]:
    """Returns the components with a pod on a node. pods: by the uid of their Deployment."""
    return frozenset(
        pod.metadata.labels.get(Label.COMPONENT, "")
        for group in pods.values()
        for pod in group
        if pod.spec.node_name and not pod.terminal
    )
