"""Devices at reserve: all or none, in the order of claim names, never rolled back.

What a failed attempt has taken stays with the pod and is found again by its next attempt; the sweep frees it when the
pod is gone or bound without it. Only behind a fence it is given back earlier (`release`). A plain rollback could free a device that a binding with a lost answer has given away.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from robotapp_api.model.names import Reason
from robotapp_claims.protocol.domains import find_claim
from robotapp_claims.protocol.writes import Api, Refused, create_claim, touch
from robotapp_claims.rules.device import Chosen, Take, busy_text, take_device
from robotapp_claims.rules.identity import Found, claim_name, device_spec, same_holder, same_tuple
from robotapp_claims.rules.objects import Claim, ClaimSpec, Holder

ROUNDS: Final = 4
"""Tries per device while others write to its claim; then the pod's next cycle tries again."""


@dataclass(frozen=True, slots=True)
class Reservation:
    """ids: the granted device ids when ok. claim: the device that stopped us otherwise.

    in_vain: what this attempt has, as last written, while another holder has the rest: to be given back.
    claims: as last written, when ok. passes: what stopped us is held for a moment only.
    """

    ok: bool
    ids: tuple[str, ...] = ()
    claim: str = ""
    reason: str = ""
    message: str = ""
    taken_by_another: bool = False
    in_vain: tuple[Claim, ...] = ()
    claims: tuple[Claim, ...] = ()
    passes: bool = False


async def reserve_devices(
    client: Api,
    *,
    holder: Holder,
    pod_uid: str,
    node: str,
    devices: Sequence[Chosen],
    momentary: bool = False,
) -> Reservation:
    """Claim `devices` of `node` for this pod. After success bind with the pod's uid and resourceVersion.

    holder: the RobotApp with instance and component, or the bare pod. momentary: until the pod is bound (`device_sharing`).
    Raises ApiError or Unreachable; calling again adopts what was created.
    """
    taken: list[Claim] = []
    for device in sorted(devices, key=lambda one: one.claim):
        spec = device_spec(
            node=node, device_type=device.type, device_id=device.id, identity=device.identity, holder=holder
        )
        found = await _reserve(client, spec, pod_uid=pod_uid, momentary=momentary)
        if isinstance(found, Reservation):
            return replace(found, in_vain=tuple(taken)) if found.taken_by_another else found
        taken.append(found)
    return Reservation(True, ids=tuple(sorted(device.id for device in devices)), claims=tuple(taken))


async def _reserve(client: Api, spec: ClaimSpec, *, pod_uid: str, momentary: bool) -> Claim | Reservation:
    """The claim when the device is ours, else why it is not."""
    claim: Claim | None = None
    holder, name = spec.holder, claim_name(spec)
    for _ in range(ROUNDS):
        if claim is None:
            claim = await create_claim(client, spec, momentary=momentary) or await find_claim(client, name)
        if claim is None:
            continue  # freed between the two requests: create again
        if same_tuple(spec, claim.spec) is Found.COLLISION:
            return _blocked(claim, holder)
        if take_device(claim, holder=holder, pod_uid=pod_uid) is Take.BUSY:
            return _blocked(claim, holder)
        try:
            return await touch(client, claim, pod=pod_uid, node=spec.device.node if spec.device else "")
        except Refused:
            claim = await find_claim(client, name)
    return Reservation(False, claim=name, reason=Reason.DEVICE_BUSY, message=f"{name} keeps changing; trying again")


def _blocked(claim: Claim, holder: Holder) -> Reservation:
    text = busy_text(claim, for_namespace=holder.namespace)
    # Its own component's device comes free together with what is taken already: the predecessor is ending.
    another = not same_holder(claim.holder, holder)
    return Reservation(
        False,
        claim=claim.name,
        reason=Reason.DEVICE_BUSY,
        message=text,
        taken_by_another=another,
        passes=claim.momentary,
    )
