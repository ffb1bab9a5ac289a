"""Devices that a running pod holds and that are not there any more.

A node's agent lists an unplugged device for an hour as not present, then no longer. A device of which the agent lists nothing
may be one that it does not know, so it counts as lost only while the Deployment's annotation `robotics.io/lost-devices` has it.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from robotapp_claims.rules.device import is_device
from robotapp_claims.rules.identity import device_label
from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.spec.objects import Telemetry

MAX_BYTES: Final = 16 * 1024


class LostDevice(NamedTuple):
    """`claim` is the name of the RobotClaim, `pod` the uid of the pod that uses the device."""

    component: str
    claim: str
    pod: str
    device: str
    node: str

    def __str__(self) -> str:
        return _named(self.device, self.node)


def name_of(claim: Claim) -> str:
    """The claimed device as `LostDevice` names it; "" for the claim of a domain."""
    thing = claim.spec.device
    return _named(thing.id, thing.node) if thing else ""


def _named(device: str, node: str) -> str:
    return f"device {device} on {node}"


def is_there(claim: Claim, telemetry: Mapping[str, Telemetry]) -> bool | None:
    """Whether the agent of its node reports the claimed device as present. None when it reports nothing about it."""
    thing = claim.spec.device
    report = telemetry.get(thing.node) if thing else None
    if thing is None or report is None:
        return None
    known = {device_label(device.id) for device in report.status.devices}
    found = [device for device in report.status.devices if is_device(thing, device, known=known)]
    return any(device.present for device in found) if found else None


def lost_devices(
    claims: Iterable[Claim], telemetry: Mapping[str, Telemetry], *, users: Iterable[str], recorded: Mapping[str, str]
) -> tuple[LostDevice, ...]:
    """The lost devices of one instance, sorted. users: uids of pods that are not ending. recorded: claim -> pod that lost it."""
    alive, found = frozenset(users), []
    for claim in claims:
        thing, pod = claim.spec.device, claim.status.pod
        if thing is None or claim.draining or pod not in alive:
            continue
        there = is_there(claim, telemetry)
        if there is False or (there is None and recorded.get(claim.name) == pod):
            found.append(LostDevice(claim.holder.component, claim.name, pod, thing.id, thing.node))
    return tuple(sorted(found))


def record_text(recorded: Mapping[str, str]) -> str:
    """The value of the annotation LOST_DEVICES."""
    return json.dumps(dict(sorted(recorded.items())), separators=(",", ":"))


def parse_record(text: str) -> dict[str, str]:
    """The recorded losses; empty for a value that cannot be read: devices that are lost now are found again."""
    try:
        value = json.loads(text) if 0 < len(text) <= MAX_BYTES else {}
    except (ValueError, RecursionError):
        return {}
    return {str(key): pod for key, pod in value.items() if isinstance(pod, str)} if isinstance(value, dict) else {}
