"""Sharing a device: pods that share it hold no claim, except while each of them is being bound.

A pod that needs the device exclusively creates the claim first and then looks for bound pods that share the device. Creating is
mutual exclusion: the second of two schedulers finds the claim of the first, or the pod that the first has bound.
"""

import asyncio
from collections.abc import Sequence
from typing import Final

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.devices import Reservation, reserve_devices
from robotapp_claims.protocol.writes import Api, Refused, delete_claim
from robotapp_claims.rules.device import Chosen
from robotapp_claims.rules.identity import holder_of_pod, shared_devices, shown_name
from robotapp_claims.rules.objects import Holder, Pod
from robotapp_client.api.resources import PODS

WAITS_S: Final = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Pauses between tries: the claim of another pod that is being bound is deleted within a few milliseconds."""


async def begin_sharing(
    client: Api, *, namespace: str, pod: str, pod_uid: str, node: str, devices: Sequence[Chosen]
) -> Reservation:
    """Claim these devices until the pod is bound; not ok when another holder has one of them exclusively.

    The holder is the pod itself: once it is bound or gone, the sweep deletes a claim that `end_sharing` could not.
    """
    holder = holder_of_pod(namespace=namespace, name=pod, uid=pod_uid)
    found = Reservation(True)
    for wait_s in (*WAITS_S, None):
        found = await reserve_devices(
            client, holder=holder, pod_uid=pod_uid, node=node, devices=devices, momentary=True
        )
        if found.ok or not found.passes or wait_s is None:
            break
        await asyncio.sleep(wait_s)
    return found


async def end_sharing(client: Api, found: Reservation) -> None:
    """The pod is bound: delete its claims. The sweep handles a claim that changed meanwhile."""
    for claim in found.claims:
        try:
            await delete_claim(client, claim)
        except Refused:
            continue


async def shared_by_others(
    client: Api, *, holder: Holder, pod_uid: str, node: str, devices: Sequence[Chosen]
) -> Reservation:
    """Whether bound pods share one of these devices; call it when `holder` has their claims. Not ok names the first such pod."""
    wanted = {device.id for device in devices}
    pods = await client.list(PODS, field_selector=f"spec.nodeName={node}", as_type=Pod)
    for pod in pods.items:
        used = sorted(wanted & shared_devices(pod.metadata.annotations))
        if used and pod.metadata.uid != pod_uid and not pod.terminal:
            meta = pod.metadata
            holder_name = shown_name(meta.namespace, meta.name, for_namespace=holder.namespace)
            text = f"device {used[0]} on {node} is shared by {holder_name}: it is free when its pods are gone"
            return Reservation(False, reason=Reason.DEVICE_BUSY, message=text, taken_by_another=True)
    return Reservation(True)
