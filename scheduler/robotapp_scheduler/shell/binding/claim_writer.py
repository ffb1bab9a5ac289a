"""Writes allocations and users of ResourceClaims before a pod is bound, in the order in which kube-scheduler writes them.

A claim that is not allocated gets the finalizer that protects an allocation, then allocation and users in one status update. A
claim of a RobotApp gets no finalizer, which would hang its deletion behind a dead program, and the RobotApp as a user beside
the pod, so that the allocation outlives the pod (docs/devices.md). Its next pod is entered when the pods before are gone, and the
same write takes these off.

Every write is for the version that was read, so it takes effect at most once, and may be cancelled or lost at any await: the
next attempt, also of another process, reads the claim and finds its own allocation there, or none.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final

import msgspec

from robotapp_api.values.quantities.times import whole_seconds
from robotapp_client.api.bodies import JSON_PATCH, STRATEGIC
from robotapp_client.api.client import ApiClient, Json
from robotapp_client.api.resources import PODS, RESOURCECLAIMS
from robotapp_client.api.times import Now
from robotapp_client.transport.errors import (
    ApiError,
    ClientError,
    Conflict,
    NotFound,
    ServerError,
    TooManyRequests,
    means_gone,
)
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import (
    ClaimPlan,
    PlannedClaim,
    find_robotapp,
    is_reserved_for,
)
from robotapp_scheduler.core.dynamic_resources.objects import (
    AllocationResult,
    ResourceClaim,
    ResourceClaimConsumerReference,
)
from robotapp_scheduler.core.dynamic_resources.standing_consumers import (
    explain_predecessor,
    list_next_users,
    list_predecessors,
)
from robotapp_scheduler.core.events.cluster_event import Event
from robotapp_scheduler.core.pods.pod_info import PodInfo

log = logging.getLogger(__name__)

FINALIZER: Final = "resource.kubernetes.io/delete-protection"
TRIES: Final = 5
"""Conflicts in a row after which the pod goes back to the queue; pods that share a claim and are bound together meet some."""
FIRST_DELAY_S: Final = 0.01
MOST_DELAY_S: Final = 2.0
DEPOSED: Final = "this scheduler is not the leader any more"


class UnwritableError(Exception):
    """The claim cannot be written as decided; the pod has to be scheduled again."""


class ClaimWriter:
    """One per process. `permitted` is called before every write: whether this process still holds the lease.

    `on_change` gets what a write changed, which the watch shows later as nothing new. `retry` schedules a pod again.
    """

    def __init__(
        self,
        client: ApiClient,
        claims: ClaimCache,
        *,
        permitted: Callable[[], bool],
        now: Now,
        on_change: Callable[[Event], None],
        retry: Callable[[str], None],
    ) -> None:
        self._client = client
        self._claims = claims
        self._permitted = permitted
        self._now = now
        self._on_change = on_change
        self._retry = retry
        self._tasks: set[asyncio.Task[None]] = set()

    def __repr__(self) -> str:
        return f"<ClaimWriter, {len(self._tasks)} deallocations in flight>"

    async def bind(self, pod: PodInfo, plan: ClaimPlan) -> str:
        """Implements `core.framework.handle.ResourceClaims.bind`. Raises no error of the API server."""
        for planned_claim in plan.claims:
            try:
                await self._bind_claim(pod, planned_claim)
            except (UnwritableError, ClientError) as error:
                return str(error)
            except RecursionError:
                return f"parameters of a driver in claim {planned_claim.claim} are nested too deep: write them flatter"
        return ""

    async def release(self, pod: PodInfo, plan: ClaimPlan) -> None:
        """Implements `core.framework.handle.ResourceClaims.release`. What fails is tried again with the pod's next attempt."""
        for planned_claim in plan.claims:
            meta = planned_claim.claim.metadata
            claim = self._claims.get(meta.namespace, meta.name)
            if claim is None:
                continue
            try:
                await self._release_claim(claim, pod, uid=meta.uid)
            except (UnwritableError, ClientError) as error:
                log.warning("%s stays among the users of resource claim %s: %s", pod.key, claim, error)

    def deallocate(self, claim: ResourceClaim, pod: PodInfo) -> None:
        """Implements `core.framework.handle.ResourceClaims.deallocate`. When it fails the pod is tried again."""
        task = asyncio.create_task(self._deallocate(claim, pod), name=f"deallocate {claim}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def drain(self, timeout_s: float) -> None:
        """Wait for the deallocations in flight."""
        if self._tasks:
            await asyncio.wait(set(self._tasks), timeout=timeout_s)

    async def free(self, claim: ResourceClaim) -> None:
        """Take allocation and users from a claim, for this version of it. Raises ClientError."""
        if not self._permitted():
            raise UnwritableError(DEPOSED)
        status: Json = {"allocation": None, "reservedFor": None, "devices": None}
        await self._patch(claim, {"metadata": _make_preconditions(claim), "status": status}, "status")

    async def _deallocate(self, claim: ResourceClaim, pod: PodInfo) -> None:
        try:
            await self.free(claim)
        except Conflict:
            return  # the claim changed, and its event is about to move the pod
        except (ClientError, UnwritableError) as error:
            log.warning("resource claim %s cannot be deallocated for %s: %s", claim, pod.key, error)
            self._retry(pod.uid)

    # --- One claim -------------------------------------------------------------------------------------------------

    async def _bind_claim(self, pod: PodInfo, planned_claim: PlannedClaim) -> None:
        """Write one claim; after a conflict or a reply that got lost, read it and write what is left to be written."""
        meta = planned_claim.claim.metadata
        claim = self._claims.get(meta.namespace, meta.name) or planned_claim.claim
        conflicts = failures = 0
        while True:
            if not self._permitted():
                raise UnwritableError(DEPOSED)
            try:
                await self._write(claim, pod, planned_claim)
            except Conflict as error:
                conflicts += 1
                if conflicts == TRIES:
                    raise UnwritableError(_explain_failure(planned_claim, error)) from error
            except ClientError as error:
                if not (error.maybe_applied or isinstance(error, ServerError | TooManyRequests)):
                    raise UnwritableError(_explain_failure(planned_claim, error)) from error
                # What was sent may still take effect. The same write for the same version decides it: one of the two applies.
                failures += 1
                await self._pause(failures, error)
            else:
                return
            claim = await self._read(planned_claim, claim)

    async def _release_claim(self, claim: ResourceClaim, pod: PodInfo, *, uid: str) -> None:
        """Take the pod from the users of the claim with this uid. Raises UnwritableError and ClientError.

        The write is for one version: what a deposed leader had sent would take a pod off that its successor has bound.
        """
        meta = claim.metadata
        for attempt in range(TRIES):
            if claim.metadata.uid != uid or not is_reserved_for(claim, pod.uid):
                return
            if not self._permitted():
                raise UnwritableError(DEPOSED)
            status = {"reservedFor": [{"$patch": "delete", "uid": pod.uid}]}
            patch = {"metadata": _make_preconditions(claim), "status": status}
            try:
                await self._patch(claim, patch, "status", content_type=STRATEGIC)
            except Conflict:
                if attempt == TRIES - 1:
                    raise
            else:
                return
            claim = await self._client.get(RESOURCECLAIMS, meta.name, namespace=meta.namespace, as_type=ResourceClaim)

    async def _check_predecessors(self, claim: ResourceClaim, pod: PodInfo) -> None:
        """Raises UnwritableError while a pod that has to be gone before exists. The cache may not show a pod that is new."""
        for user in list_predecessors(claim, pod.uid):
            if await self._has_pod(claim.metadata.namespace, user):
                raise UnwritableError(explain_predecessor(claim, user))

    async def _has_pod(self, namespace: str, user: ResourceClaimConsumerReference) -> bool:
        """Returns whether the API server has this pod, and it has not ended."""
        try:
            pod = await self._client.get(PODS, user.name, namespace=namespace, as_type=Pod)
        except NotFound as error:
            if means_gone(error, user.name):
                return False
            raise
        return pod.metadata.uid == user.uid and not pod.terminal

    async def _read(self, planned_claim: PlannedClaim, claim: ResourceClaim) -> ResourceClaim:
        """The claim as stored now. While the API server does not answer, the caller's state."""
        meta = planned_claim.claim.metadata
        try:
            return await self._client.get(RESOURCECLAIMS, meta.name, namespace=meta.namespace, as_type=ResourceClaim)
        except ApiError as error:
            if error.status < 500 and error.status != 429:
                raise UnwritableError(f"get updated claim {planned_claim.claim} after conflict: {error}") from error
        except ClientError:
            pass
        return claim

    async def _pause(self, failures: int, error: ClientError) -> None:
        wish_s = error.pause_s if isinstance(error, ApiError) else 0.0
        await self._client.sleep(max(wish_s, min(MOST_DELAY_S, FIRST_DELAY_S * 5.0 ** min(failures, 6))))

    async def _write(self, claim: ResourceClaim, pod: PodInfo, planned_claim: PlannedClaim) -> None:
        """Bring the claim from this state to the planned one. Raises UnwritableError when its state rules that out."""
        name, allocation = planned_claim.claim, planned_claim.allocation
        if claim.metadata.uid != planned_claim.claim.metadata.uid:
            raise UnwritableError(f"claim {name} got deleted in the meantime")
        if claim.metadata.deletion_timestamp is not None:
            raise UnwritableError(f"claim {name} got deleted in the meantime")
        stored_allocation = claim.status.allocation
        if stored_allocation is not None and allocation is not None:
            if _get_devices_and_nodes(stored_allocation) != _get_devices_and_nodes(allocation):
                raise UnwritableError(f"claim {name} got allocated elsewhere in the meantime")
            allocation = None  # ours: a reply was lost, or another pod of the group wrote it
        elif stored_allocation is None and allocation is None:
            raise UnwritableError(f"claim {name} got deallocated elsewhere in the meantime")
        if allocation is not None and find_robotapp(claim) is None:
            claim = await self._protect(claim)
        await self._check_predecessors(claim, pod)
        next_users = list_next_users(claim, name=pod.name, uid=pod.uid, allocates=allocation is not None)
        if allocation is None and next_users == tuple(claim.status.reserved_for):
            return
        users = [_encode(user) for user in next_users]
        if allocation is None:
            patch: Json = {"metadata": _make_preconditions(claim), "status": {"reservedFor": users}}
            await self._patch(claim, patch, "status")
            return
        status_allocation = {**_encode(allocation), "allocationTimestamp": whole_seconds(self._now())}
        # A merge patch would drop every null in the parameters of a driver. The version is the condition here as well.
        operations: list[Json] = [
            {"op": "replace", "path": "/metadata/resourceVersion", "value": claim.metadata.resource_version},
            {"op": "add", "path": "/status", "value": {"allocation": status_allocation, "reservedFor": users}},
        ]
        await self._patch(claim, operations, "status", content_type=JSON_PATCH)

    async def _protect(self, claim: ResourceClaim) -> ResourceClaim:
        """Give the claim the finalizer without which the claim controller would never take the allocation back."""
        finalizers = claim.metadata.finalizers or []
        if FINALIZER in finalizers:
            return claim
        metadata = {**_make_preconditions(claim), "finalizers": [*finalizers, FINALIZER]}
        return await self._patch(claim, {"metadata": metadata})

    async def _patch(
        self, claim: ResourceClaim, patch: Json | list[Json], subresource: str = "", **content_type: str
    ) -> ResourceClaim:
        meta = claim.metadata
        reply = await self._client.patch(
            RESOURCECLAIMS, meta.name, patch, namespace=meta.namespace, subresource=subresource, **content_type
        )
        written_claim = msgspec.convert(reply, ResourceClaim)
        old = self._claims.get(meta.namespace, meta.name)
        change = self._claims.record_write(written_claim)
        if change:
            self._on_change(Event(RESOURCECLAIMS.plural, change, old, written_claim))
        return written_claim


def _get_devices_and_nodes(allocation: AllocationResult) -> tuple[object, ...]:
    """Returns what makes two allocations of a claim the same one."""
    return allocation.devices.results, allocation.node_selector


def _make_preconditions(claim: ResourceClaim) -> Json:
    return {"uid": claim.metadata.uid, "resourceVersion": claim.metadata.resource_version}


def _encode(value: Any) -> Json:
    document: Json = msgspec.json.decode(msgspec.json.encode(value))
    return document


def _explain_failure(planned_claim: PlannedClaim, error: ClientError) -> str:
    written_part = "allocation and reservation" if planned_claim.allocation is not None else "reservation"
    return f"add {written_part} to claim {planned_claim.claim}: {error}"
