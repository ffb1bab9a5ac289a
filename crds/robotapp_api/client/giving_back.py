"""F4: a pod that waits gives devices back that it cannot use yet. Fence, then release.

The pod's version moves first, so that a Binding which somebody else decided on the older version fails; then the claim is
deleted as it was read. Without the fence a sleeping scheduler could bind the pod with a device that is somebody else's
by then (`DM7` of the claim model).
"""

from collections.abc import Iterable
from typing import Any

from robotapp_api.claims.objects import Claim, Pod
from robotapp_api.client.apply import STRATEGIC
from robotapp_api.client.claim_writes import Api, Refused, delete_claim
from robotapp_api.client.errors import Conflict, NotFound
from robotapp_api.client.resources import PODS
from robotapp_api.client.times import Now, utc_now, whole_seconds


async def give_back(client: Api, pod: Pod, claims: Iterable[Claim], *, now: Now = utc_now) -> int:
    """How many of the pod's device claims were given back. pod and claims: as read before, in any order.

    A pod that changed meanwhile keeps everything, perhaps it was bound; a claim that changed stays. Raises ApiError or Unreachable; what was not given back is found again.
    """
    if pod.spec.node_name or not await _fence(client, pod, now=now):
        return 0
    count = 0
    for claim in claims:
        try:
            await delete_claim(client, claim)
        except Refused:
            continue
        count += 1
    return count


async def _fence(client: Api, pod: Pod, *, now: Now) -> bool:
    """Whether the pod's version has moved away from the one that was read. What the pod says of itself stays."""
    meta = pod.metadata
    condition: dict[str, Any] = {
        "type": "PodScheduled",
        "status": "False",
        "lastProbeTime": whole_seconds(now()),
    }
    patch = {
        "metadata": {"uid": meta.uid, "resourceVersion": meta.resource_version},
        "status": {"conditions": [condition]},
    }
    try:
        answer = await client.patch(
            PODS, meta.name, patch, namespace=meta.namespace, subresource="status", content_type=STRATEGIC
        )
    except (Conflict, NotFound):
        return False
    version: str = answer["metadata"]["resourceVersion"]
    return version != meta.resource_version  # a write that changes nothing fences nothing
