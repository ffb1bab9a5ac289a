"""Adds a pod to `reservedFor` of its ResourceClaims before it is bound: the kubelet prepares devices for these pods only.

An entry is never removed here: the claim controller removes those of pods that ended, and the next attempt of a pod finds
its own.
"""

import msgspec

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import RESOURCECLAIMS
from robotapp_client.transport.errors import ClientError, Conflict
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.resource_claims import ResourceClaim, trouble, wanted

TRIES = 5
"""Each write is for the version that was read, so pods that share a claim and are bound together meet conflicts."""


class ClaimUsers:
    """One per process."""

    def __init__(self, client: ApiClient) -> None:
        self._client = client

    def __repr__(self) -> str:
        return "<ClaimUsers>"

    async def enter(self, pod: PodInfo) -> str:
        """Make the pod a user of all its claims. Returns why it cannot be, "" when it is; raises no error of the API server."""
        for each in wanted(pod.pod):
            if each.claim is None:
                continue
            try:
                problem = await self._enter(pod, each.claim, made_for_pod=each.made_for_pod)
            except ClientError as error:
                problem = f"resource claim {each.claim!r}: {error}"
            if problem:
                return problem
        return ""

    async def _enter(self, pod: PodInfo, name: str, *, made_for_pod: bool) -> str:
        user = {"resource": "pods", "name": pod.name, "uid": pod.uid}
        for _ in range(TRIES):
            claim = await self._client.get(RESOURCECLAIMS, name, namespace=pod.namespace, as_type=ResourceClaim)
            problem = trouble(claim, pod.pod, made_for_pod=made_for_pod)
            users = claim.status.reserved_for
            if problem or any(each.uid == pod.uid for each in users):
                return problem
            patch = {
                "metadata": {"uid": claim.metadata.uid, "resourceVersion": claim.metadata.resource_version},
                "status": {"reservedFor": [*msgspec.to_builtins(users), user]},
            }
            try:
                await self._client.patch(RESOURCECLAIMS, name, patch, namespace=pod.namespace, subresource="status")
            except Conflict:
                continue
            return ""
        return f"resource claim {name!r} changes faster than it can be read"
