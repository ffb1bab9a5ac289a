"""Devices at reserve: all or none, in the order of claim names, never rolled back.

What a failed attempt has taken stays with the pod and is found again by its next attempt; the sweep frees it when the
pod is gone or bound without it. Only behind a fence it is given back earlier (`giving_back`). A plain rollback could free a device that a binding with a lost answer has given away.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from robotapp_api.claims.device import Chosen, Take, busy_text, take_device
from robotapp_api.claims.identity import Found, device_spec, same_holder, same_tuple
from robotapp_api.claims.objects import Claim, Holder
from robotapp_api.client.claim_writes import Api, Refused, create_claim, touch
from robotapp_api.client.claims import find_claim
from robotapp_api.model.names import Reason

ROUNDS = 4
"""Tries per device while others write to its claim; then the pod's next cycle tries again."""


@dataclass(frozen=True, slots=True)
class Reservation:
    """ids: the granted device ids when ok. claim: the device that stopped us otherwise.

    in_vain: what this attempt has, as last written, while another holder has the rest: to be given back.
    """

    ok: bool
    ids: tuple[str, ...] = ()
    claim: str = ""
    reason: str = ""
    message: str = ""
    taken_by_another: bool = False
    in_vain: tuple[Claim, ...] = ()


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
    taken: list[Claim] = []
    for device in sorted(devices, key=lambda one: one.claim):
        found = await _reserve(
            client, holder=holder, pod_uid=pod_uid, node=node, device=device, cached=(known or {}).get(device.claim)
        )
        if isinstance(found, Reservation):
            return replace(found, in_vain=tuple(taken)) if found.taken_by_another else found
        taken.append(found)
    return Reservation(True, ids=tuple(sorted(device.id for device in devices)))


async def _reserve(
    client: Api, *, holder: Holder, pod_uid: str, node: str, device: Chosen, cached: Claim | None
) -> Claim | Reservation:
    """The claim when the device is ours, else why it is not."""
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
            return await touch(client, claim, pod=pod_uid, node=node)
        except Refused:
            claim = await find_claim(client, device.claim)
    return Reservation(
        False, claim=device.claim, reason=Reason.DEVICE_BUSY, message=f"{device.claim} keeps changing; trying again"
    )


async def may_share(client: Api, *, holder: Holder, pod_uid: str, devices: Sequence[Chosen]) -> Reservation:
    """Whether nobody else holds one of these devices alone, read with a quorum. A device in shared use has no claim."""
    for device in devices:
        claim = await find_claim(client, device.claim)
        if claim is not None and take_device(claim, holder=holder, pod_uid=pod_uid) is Take.BUSY:
            return _blocked(claim, holder)
    return Reservation(True)


def _blocked(claim: Claim, holder: Holder) -> Reservation:
    text = busy_text(claim, for_namespace=holder.namespace)
    # Its own component's device comes free together with what is taken already: the predecessor is ending.
    another = not same_holder(claim.holder, holder)
    return Reservation(False, claim=claim.name, reason=Reason.DEVICE_BUSY, message=text, taken_by_another=another)
