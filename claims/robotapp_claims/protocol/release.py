"""F4: a pod that waits gives devices back that it cannot use yet. Fence, then release.

The pod's version moves first, so that a Binding which another scheduler decided on the older version fails; then the claim
is deleted as it was read. Without the fence a sleeping scheduler could bind the pod with a device that has another holder
by then (`DM7` of the claim model).
"""

from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Final

from robotapp_api.values.quantities.times import whole_seconds
from robotapp_claims.protocol.writes import Api, Refused, delete_claim
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_client.api.bodies import STRATEGIC
from robotapp_client.api.resources import PODS
from robotapp_client.api.times import Now, utc_now
from robotapp_client.transport.errors import Conflict, NotFound

SECOND: Final = timedelta(seconds=1)


async def give_back(client: Api, pod: Pod, claims: Iterable[Claim], *, now: Now = utc_now) -> int:
    """How many of the pod's device claims were given back. pod and claims: as read before, in any order; without claims nothing is written.

    A pod that changed meanwhile keeps everything, perhaps it was bound; a claim that changed stays. Raises ApiError or Unreachable; what was not given back is found again.
    """
    claims = tuple(claims)
    if not claims or pod.spec.node_name or not await _fence(client, pod, now=now):
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
    """Whether the pod's version has moved away from the one that was read. The condition's reason and message stay.

    `lastProbeTime` has whole seconds, and a write that changes nothing keeps the version. Of two different seconds one
    differs from the stored one, so the second write moves the version where the first did not.
    """
    probed = now()
    try:
        return await _write_probe_time(client, pod, probed) or await _write_probe_time(client, pod, probed + SECOND)
    except (Conflict, NotFound):
        return False


async def _write_probe_time(client: Api, pod: Pod, moment: datetime) -> bool:
    """Whether writing `moment` changed the pod. Raises Conflict or NotFound where the pod is not as it was read."""
    meta = pod.metadata
    condition = {"type": "PodScheduled", "status": "False", "lastProbeTime": whole_seconds(moment)}
    patch = {
        "metadata": {"uid": meta.uid, "resourceVersion": meta.resource_version},
        "status": {"conditions": [condition]},
    }
    answer = await client.patch(
        PODS, meta.name, patch, namespace=meta.namespace, subresource="status", content_type=STRATEGIC
    )
    return bool(answer["metadata"]["resourceVersion"] != meta.resource_version)
