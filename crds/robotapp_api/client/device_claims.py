"""Devices at reserve: all or none, in the order of claim names, never rolled back.

What a failed attempt has taken stays with the pod and is found again by its next attempt; the sweep frees it when the
pod is gone or bound without it. A rollback could free a device that a binding with a lost answer has given away.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robotapp_api.claims.device import Chosen, Take, busy_text, take_device
from robotapp_api.claims.identity import Found, device_spec, same_tuple
from robotapp_api.claims.objects import Claim, Holder
from robotapp_api.client.claim_writes import Api, Refused, create_claim, touch
from robotapp_api.client.claims import find_claim
from robotapp_api.model.names import Reason

ROUNDS = 4
"""Tries per device while others write to its claim; then the pod's next cycle tries again."""


@dataclass(frozen=True, slots=True)
class Reservation:
    """ids: the granted device ids when ok. claim: the device that stopped us otherwise."""

    ok: bool
    ids: tuple[str, ...] = ()
    claim: str = ""
    reason: str = ""
    message: str = ""


async def reserve_devices(
    client: Api,
    *,
    holder: Holder,
    pod_uid: str,
    node: str,
    devices: Sequence[Chosen],
    known: Mapping[str, Claim] | None = None,
) -> Reservation:
    """Claim `devices` of `node` for this pod. After success bind with the pod's uid and resourceVersion.

    holder: the RobotApp with instance and component, or the bare pod. known: claims from a cache; they only save a
    request, the compare-and-swap decides. Raises ApiError or Unreachable; calling again adopts what was created.
    """
    for device in sorted(devices, key=lambda one: one.claim):
        blocker = await _reserve(
            client, holder=holder, pod_uid=pod_uid, node=node, device=device, cached=(known or {}).get(device.claim)
        )
        if blocker is not None:
            return blocker
    return Reservation(True, ids=tuple(sorted(device.id for device in devices)))


async def _reserve(
    client: Api, *, holder: Holder, pod_uid: str, node: str, device: Chosen, cached: Claim | None
) -> Reservation | None:
    """None when the device is ours."""
    spec = device_spec(node=node, device_type=device.type, device_id=device.id, identity=device.identity, holder=holder)
    claim = cached
    for _ in range(ROUNDS):
        if claim is None:
            claim = await create_claim(client, spec) or await find_claim(client, device.claim)
        if claim is None:
            continue  # freed between the two requests: create again
        if same_tuple(spec, claim.spec) is Found.COLLISION:
            return _blocked(claim, holder)
        if take_device(claim, holder=holder, pod_uid=pod_uid) is Take.BUSY:
            if claim is not cached:
                return _blocked(claim, holder)
            claim = cached = await find_claim(client, device.claim)
            if claim is not None and take_device(claim, holder=holder, pod_uid=pod_uid) is Take.BUSY:
                return _blocked(claim, holder)
            continue
        try:
            await touch(client, claim, pod=pod_uid, node=node)
        except Refused:
            claim = await find_claim(client, device.claim)
        else:
            return None
    return Reservation(
        False, claim=device.claim, reason=Reason.DEVICE_BUSY, message=f"{device.claim} keeps changing; trying again"
    )


def _blocked(claim: Claim, holder: Holder) -> Reservation:
    text = busy_text(claim, for_namespace=holder.namespace)
    return Reservation(False, claim=claim.name, reason=Reason.DEVICE_BUSY, message=text)
