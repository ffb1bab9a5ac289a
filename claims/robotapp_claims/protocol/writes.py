"""The writes of the claim protocol. Each is conditional on the version that was read; none is repeated without reading again.

`Refused` means that the object changed or vanished since it was read: the caller reads again and decides anew.
"""

from collections.abc import Callable, Collection
from typing import Any, Protocol, TypeVar

import msgspec

from robotapp_api.model.names import API_VERSION, Annotation, ClaimPhase
from robotapp_claims.rules.identity import claim_object
from robotapp_claims.rules.objects import Claim, ClaimSpec
from robotapp_claims.rules.release import preconditions
from robotapp_client.api.client import Json, Listing
from robotapp_client.api.resources import ROBOTCLAIMS, Resource
from robotapp_client.transport.errors import AlreadyExists, Conflict, NotFound, means_gone

T = TypeVar("T")


class Api(Protocol):
    """What claims need of an ApiClient; all reads are quorum reads."""

    async def get(self, resource: Resource, name: str, *, namespace: str | None = None, as_type: type[T]) -> T: ...
    async def list(
        self,
        resource: Resource,
        *,
        namespace: str | None = None,
        label_selector: str = "",
        field_selector: str = "",
        as_type: type[T],
        keep: Callable[[T], T] | None = None,
    ) -> Listing[T]: ...
    async def create(self, resource: Resource, obj: Json, *, namespace: str | None = None) -> Json: ...
    async def replace(
        self, resource: Resource, obj: Json, *, namespace: str | None = None, subresource: str = ""
    ) -> Json: ...
    async def patch(
        self, resource: Resource, name: str, patch: Json, *, namespace: str, subresource: str, content_type: str
    ) -> Json: ...
    async def delete(
        self, resource: Resource, name: str, *, uid: str | None = None, resource_version: str | None = None
    ) -> None: ...


class Refused(Exception):  # noqa: N818 - a normal answer of the protocol, not an error
    """The precondition did not hold any more."""


async def create_claim(client: Api, spec: ClaimSpec, *, momentary: bool = False, node: str = "") -> Claim | None:
    """Create the claim; None when one of this name exists, perhaps of the same holder.

    momentary: to be deleted when its pod is bound. node: where its pod is about to be bound.
    """
    body = claim_object(spec)
    if node:
        body["metadata"]["annotations"][str(Annotation.FIRST_NODE)] = node
    if momentary:
        body["metadata"]["annotations"][str(Annotation.MOMENTARY)] = "true"
    try:
        return msgspec.convert(await client.create(ROBOTCLAIMS, body), Claim)
    except AlreadyExists:
        return None


async def note_nodes(client: Api, claim: Claim, nodes: Collection[str]) -> Claim:
    """Add nodes on which pods are about to be bound, attempt + 1, also when the claim names them already.

    The new version makes a release or `strike_nodes` fail that read the claim before: the pods may run there soon.
    """
    status = {"phase": claim.status.phase, "attempt": claim.status.attempt + 1} | _use(
        claim.status.pod, claim.status.node
    )
    return await _write_status(client, claim, status, nodes={*claim.nodes, *nodes})


async def strike_nodes(client: Api, claim: Claim, nodes: Collection[str]) -> Claim:
    """Remove nodes on which none of the claim's pods runs."""
    status = {"phase": claim.status.phase, "attempt": claim.status.attempt} | _use(claim.status.pod, claim.status.node)
    return await _write_status(client, claim, status, nodes={*claim.status.nodes} - {*nodes})


async def park(client: Api, claim: Claim) -> Claim:
    """Set phase Parked: the holder keeps the thing, because its pods may still run on nodes that are unreachable. The nodes stay."""
    return await _write_status(client, claim, {"phase": ClaimPhase.PARKED.value, "attempt": claim.status.attempt})


async def touch(client: Api, claim: Claim, *, pod: str = "", node: str = "") -> Claim:
    """Adopt the claim: attempt + 1, phase Reserved. A release that read the claim before fails."""
    return await _write_status(
        client, claim, {"phase": ClaimPhase.RESERVED.value, "attempt": claim.status.attempt + 1} | _use(pod, node)
    )


async def drain(client: Api, claim: Claim) -> Claim:
    """Phase 1 of a release: phase Draining. The pod of a device is removed, so that a successor may adopt the claim."""
    return await _write_status(client, claim, {"phase": ClaimPhase.DRAINING.value, "attempt": claim.status.attempt})


async def delete_claim(client: Api, claim: Claim) -> None:
    """Phase 2 of a release, on condition of uid and resourceVersion. Already gone is fine."""
    condition = preconditions(claim)
    try:
        await client.delete(ROBOTCLAIMS, claim.name, uid=condition.uid, resource_version=condition.resource_version)
    except Conflict as refusal:
        raise Refused from refusal
    except NotFound as error:
        if not means_gone(error, claim.name):
            raise


def _use(pod: str, node: str) -> dict[str, Any]:
    return {key: value for key, value in (("pod", pod), ("node", node)) if value}


async def _write_status(
    client: Api, claim: Claim, status: dict[str, Any], *, nodes: Collection[str] | None = None
) -> Claim:
    """nodes: None keeps those of the claim."""
    condition = preconditions(claim)
    named = sorted(claim.nodes if nodes is None else nodes)
    body = {
        "apiVersion": API_VERSION,
        "kind": "RobotClaim",
        "metadata": {
            "name": claim.name,
            "uid": condition.uid,
            "resourceVersion": condition.resource_version,
        },
        "spec": claim_object(claim.spec)["spec"],
        "status": status | ({"nodes": named} if named else {}),
    }
    try:
        return msgspec.convert(await client.replace(ROBOTCLAIMS, body, subresource="status"), Claim)
    except Conflict as refusal:
        raise Refused from refusal
    except NotFound as error:
        if not means_gone(error, claim.name):
            raise
        raise Refused from error
