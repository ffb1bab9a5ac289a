"""Claims domain and devices of a pod before it is bound, and checks that the domain claim of an app's pod still stands.

The filters read a cache; here the API server decides. The next attempt of a pod finds the claims of a failed one, and the sweep
frees them when the pod is gone. Claims are given back at once only when another holder has something else that the pod needs.
"""

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from robotapp_api.model.names import GRANTED_PREFIX, Label, PodReason, Reason
from robotapp_claims.protocol.bind_check import check_bind_all
from robotapp_claims.protocol.device_sharing import begin_sharing, end_sharing, shared_by_others
from robotapp_claims.protocol.devices import Reservation, reserve_devices
from robotapp_claims.protocol.domain_allocation import PoolCapacity, capacity_of, full_pool
from robotapp_claims.protocol.domains import ensure_pod_domain
from robotapp_claims.protocol.release import give_back
from robotapp_claims.protocol.sweep_snapshot import find
from robotapp_claims.rules.bind import needs_check
from robotapp_claims.rules.device import Chosen, chosen
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.identity import grants, holder_of_app, holder_of_pod
from robotapp_claims.rules.objects import Claim, EnvVar, Holder, Meta, PodSpec, PodStatus, Pool
from robotapp_claims.rules.objects import Container as ClaimContainer
from robotapp_claims.rules.objects import Pod as ClaimPod
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import DOMAINPOOLS, PODS
from robotapp_client.transport.errors import ClientError
from robotapp_scheduler.core.api.core_v1 import Container
from robotapp_scheduler.core.framework.handle import READY, Readiness, Reserved
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.robotics.device_index import DeviceGrant
from robotapp_scheduler.plugins.ros.reserve import requested_domain, wants

log = logging.getLogger(__name__)

POOL_S: Final = 1.0
"""Greatest age of the pool that is read to reject a pod because all ids are taken. To take an id, the pool is read anew."""


class ClaimReserver:
    """Bind checks and device claims through one client. `known_claims`: those in the cache, so that no taken domain is tried."""

    def __init__(self, client: ApiClient, *, known_claims: Callable[[], Collection[Claim]] = tuple) -> None:
        self._client = client
        self._known_claims = known_claims
        self._pool: Pool | None = None
        self._reading = asyncio.Lock()
        self._trying: set[str] = set()
        """Uids of the pods that are taking a domain now: at most as many try as ids are free."""
        self._pool_read_s = self._let_through_s = float("-inf")
        """When the pool was read last, and when `known_full` last let a pod through."""
        self._capacity: tuple[Pool, tuple[Claim, ...], PoolCapacity] | None = None
        """The last count of free ids, with the pool and claims it was counted from."""

    def __repr__(self) -> str:
        return "<Reserver>"

    async def check_domains(self, placed: Sequence[tuple[PodInfo, str]]) -> dict[str, Reserved]:
        """Check rule 1 of claims.md for several pods; results by pod uid. Each claim is read once, with a quorum.

        placed: each pod with the node it is to be bound to, which is written into its claim first. A pod without a literal domain
        is READY. No pod is read: the watch showed it without a node, and the Binding, which carries its uid, is accepted only
        where it still has none; so it was pending in between, while its claim was read. Its environment never changes.
        """
        verdicts = {pod.uid: READY for pod, _ in placed}
        members = [(claim_pod(pod), node) for pod, node in placed if pod.member is not None]
        to_check = [(pod, node) for pod, node in members if needs_check(pod)]
        pods, nodes = [pod for pod, _ in to_check], [node for _, node in to_check]
        try:
            answers = await check_bind_all(self._client, pods, nodes=nodes)
        except ClientError as error:
            return verdicts | {pod.metadata.uid: _error(error) for pod in pods}
        for pod, answer in zip(pods, answers, strict=True):
            if not answer.allowed:
                verdicts[pod.metadata.uid] = Reserved(
                    Readiness.WAIT, reason=PodReason.WAITING_FOR_DOMAIN, message=answer.message
                )
        return verdicts

    async def reserve(self, pod: PodInfo, node: str, wanted: Sequence[DeviceGrant]) -> Reserved:
        """Claim what this pod is to be granted on `node`: the devices chosen for it, and a bare pod's domain.

        The pod is read first and its version becomes the Binding's precondition, so that a bind decided on an older
        state of the pod fails instead of granting twice.
        """
        if not wants(pod, wanted):
            return READY
        domain = requested_domain(pod)
        try:
            if not domain:
                return await self._claim(pod, node, wanted, "")
            full = await self._full(pod, domain)
            if full is not None:
                return full
            self._trying.add(pod.uid)
            try:
                return await self._claim(pod, node, wanted, domain)
            finally:
                self._trying.discard(pod.uid)
        except ClientError as error:
            return _error(error)

    async def _claim(self, pod: PodInfo, node: str, wanted: Sequence[DeviceGrant], domain: str) -> Reserved:
        stored = await self._stored(pod)
        if stored is None:
            return Reserved(Readiness.GONE)
        sharing, found = await self._devices(pod, node, wanted)
        if not found.ok:
            await give_back(self._client, stored, found.in_vain)
            return Reserved(Readiness.BUSY, reason=found.reason, message=found.message)
        number: int | None = None
        if domain:
            request = domain_request(pod, domain)
            outcome = await ensure_pod_domain(self._client, request, node=node, known_claims=self._known_claims)
            if not outcome.held:
                # Free the devices while this pod waits: the holder of the domain may itself wait for one of them.
                held = {claim.name: claim for claim in (*sharing.claims, *found.claims)}
                await give_back(self._client, stored, held.values())
                return Reserved(Readiness.WAIT, reason=_no_domain(outcome), message=outcome.message)
            number = outcome.id
        version = stored.metadata.resource_version
        shared = [grant.device.id for grant in wanted if not grant.exclusive]
        given = grants(domain=number, devices=found.ids, shared=shared)
        return Reserved(Readiness.READY, annotations=given, resource_version=version, sharing=sharing.claims)

    async def bound(self, reserved: Reserved) -> None:
        """The pod is bound: delete the claims of devices that it shares. Where that fails, the sweep frees them."""
        try:
            await end_sharing(self._client, Reservation(True, claims=reserved.sharing))
        except ClientError as error:
            log.info("claims of a shared device are left to the sweep: %s", error)

    async def not_bound(self, pod: PodInfo, reserved: Reserved) -> None:
        """No Binding was sent, or the pod waits for its volumes first: let others use the devices that it shares."""
        try:
            stored = await self._stored(pod)
            if stored is not None:
                await give_back(self._client, stored, reserved.sharing)
        except ClientError as error:
            log.info("claims of a shared device are left to the sweep: %s", error)

    def known_full(self, pod: PodInfo) -> Reserved | None:
        """The rejection that `reserve` would return for a pod that needs a domain, by the last pool read; None = call `reserve`.

        Once a second one pod is let through, so that its `reserve` reads the pool again.
        """
        domain, now_s = requested_domain(pod), self._client.clock()
        if not domain or self._pool is None or now_s - self._let_through_s >= POOL_S:
            self._let_through_s = now_s
            return None
        return self._pool_full(pod, domain, self._pool)

    async def _full(self, pod: PodInfo, domain: str) -> Reserved | None:
        """The rejection when other pods hold every id by the cache, else None. No id is tried then, which saves requests."""
        if not self._known_claims():
            return None
        pool = await self._recent_pool(domain_request(pod, domain).pool)
        return None if pool is None else self._pool_full(pod, domain, pool)

    def _pool_full(self, pod: PodInfo, domain: str, pool: Pool) -> Reserved | None:
        request, claims = domain_request(pod, domain), tuple(self._known_claims())
        if self._capacity is None or self._capacity[0] is not pool or self._capacity[1] != claims:
            self._capacity = (pool, claims, capacity_of(request, pool, claims))
        full = full_pool(request, pool, self._capacity[2], trying=self._trying)
        return None if full is None else Reserved(Readiness.WAIT, reason=_no_domain(full), message=full.message)

    async def _recent_pool(self, name: str) -> Pool | None:
        """The pool of bare pods, at most POOL_S old; calls at the same time share one read."""
        async with self._reading:
            now_s = self._client.clock()
            if now_s - self._pool_read_s >= POOL_S:
                self._pool = await find(self._client, DOMAINPOOLS, name, "", Pool)
                self._pool_read_s = now_s
            return self._pool

    async def _devices(self, pod: PodInfo, node: str, wanted: Sequence[DeviceGrant]) -> tuple[Reservation, Reservation]:
        """The claims that are held until the pod is bound, and the grant. When not all devices are free, `in_vain` are those taken."""
        client, holder = self._client, holder_of(pod)
        shared, exclusive = [[thing(grant) for grant in wanted if grant.exclusive is alone] for alone in (False, True)]
        sharing = await begin_sharing(
            client, namespace=pod.namespace, pod=pod.name, pod_uid=pod.uid, node=node, devices=shared
        )
        if not sharing.ok or not exclusive:
            return sharing, replace(sharing, ids=())
        found = await reserve_devices(client, holder=holder, pod_uid=pod.uid, node=node, devices=exclusive)
        if found.ok:
            others = await shared_by_others(client, holder=holder, pod_uid=pod.uid, node=node, devices=exclusive)
            found = found if others.ok else replace(others, in_vain=found.claims)
        return sharing, found if found.ok else replace(found, in_vain=(*found.in_vain, *sharing.claims))

    async def _stored(self, pod: PodInfo) -> ClaimPod | None:
        """The pod as stored; None when it is gone, re-created, being deleted or ended."""
        stored = await find(self._client, PODS, pod.name, pod.namespace, ClaimPod)
        if stored is None or stored.metadata.uid != pod.uid or stored.metadata.deletion_timestamp or stored.terminal:
            return None
        return stored


def claim_pod(pod: PodInfo) -> ClaimPod:
    """A pod that waits for its Binding, as far as the bind check reads it."""
    spec = pod.pod.spec
    return ClaimPod(
        metadata=Meta(
            name=pod.name, namespace=pod.namespace, uid=pod.uid, labels=pod.labels, annotations=pod.annotations
        ),
        spec=PodSpec(containers=_containers(spec.containers), init_containers=_containers(spec.init_containers)),
    )


def _containers(found: Iterable[Container] | None) -> tuple[ClaimContainer, ...]:
    """Those that set a domain."""
    return tuple(
        ClaimContainer(
            env=tuple(EnvVar(name=each.name, value=each.value, value_from=each.value_from) for each in container.env)
        )
        for container in found or ()
        if container.env
    )


def granted_pods(placed: Iterable[PlacedPod]) -> Iterator[ClaimPod]:
    """Running bare pods with grants: the sweep creates their claims again when these were deleted by hand."""
    for record in placed:
        meta = record.pod.metadata
        annotations = meta.annotations
        if record.member is None and annotations and any(key.startswith(GRANTED_PREFIX) for key in annotations):
            yield ClaimPod(
                metadata=Meta(
                    name=meta.name,
                    namespace=meta.namespace,
                    uid=meta.uid,
                    resource_version=meta.resource_version,
                    labels=meta.labels or {},
                    annotations=annotations,
                    deletion_timestamp=meta.deletion_timestamp,
                ),
                spec=PodSpec(node_name=record.node),
                status=PodStatus(phase=record.pod.status.phase),
            )


def holder_of(pod: PodInfo) -> Holder:
    """Devices belong to the app's component, or to a bare pod itself."""
    if pod.member is None:
        return holder_of_pod(namespace=pod.namespace, name=pod.name, uid=pod.uid)
    return holder_of_app(
        namespace=pod.namespace,
        name=pod.labels.get(Label.APP, ""),
        uid=pod.member.app_uid,
        instance=pod.member.instance,
        component=pod.member.component,
    )


def domain_request(pod: PodInfo, domain: str) -> DomainRequest:
    requested = None if domain == "auto" else int(domain)
    return DomainRequest(holder=holder_of(pod), requested_id=requested)


def thing(grant: DeviceGrant) -> Chosen:
    device = grant.device
    return chosen(node=grant.node, device_id=device.id, device_type=device.type, identity=device.identity)


def _no_domain(outcome: DomainOutcome) -> PodReason:
    """The reason of a pod without a domain: it waits for another holder, or its annotation asks for an id that is not allowed."""
    return PodReason.INVALID_ANNOTATION if outcome.reason is Reason.INVALID_SPEC else PodReason.WAITING_FOR_DOMAIN


def _error(error: ClientError) -> Reserved:
    return Reserved(Readiness.ERROR, reason=PodReason.SCHEDULER_ERROR, message=str(error))
