"""Devices: what fits a requirement, who may take it, when it is given back.

A device claim belongs to app uid + instance + component and is used by one pod (`status.pod`). When that pod is gone the
claim waits, Draining, for a successor of the same component, so a restarted driver gets its own camera back.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Protocol

from robotapp_api.claims.identity import claim_name_device, device_label, granted_devices, holder_text, same_holder
from robotapp_api.claims.objects import App, Claim, Holder, Pod
from robotapp_api.claims.release import Release
from robotapp_api.model.names import Reason

_USB_IDENTITY: Final = re.compile(r"(?:usb:)?([0-9a-f]{4}:[0-9a-f]{4})(?::(.*))?", re.IGNORECASE)


class Kind(Protocol):
    """What a device must be. Empty fields accept anything."""

    @property
    def type(self) -> str: ...
    @property
    def model(self) -> str: ...
    @property
    def interface(self) -> str: ...
    @property
    def match(self) -> str | None: ...


class Requirement(Kind, Protocol):
    """RobotApp `devices` entry; the model and the sweep's struct both fit."""

    @property
    def name(self) -> str: ...
    @property
    def exclusive(self) -> bool: ...


class Described(Protocol):
    """What is known about a device, wherever it is kept."""

    @property
    def type(self) -> str: ...
    @property
    def model(self) -> str: ...
    @property
    def interface(self) -> str: ...
    @property
    def identity(self) -> str: ...


class Reported(Described, Protocol):
    """A device as the node's agent reports it (NodeTelemetry)."""

    @property
    def id(self) -> str: ...
    @property
    def present(self) -> bool: ...


class Take(StrEnum):
    """What a pod may do about one device."""

    CREATE = "Create"
    ADOPT = "Adopt"
    """It has the claim already (an earlier attempt): touch it."""
    TAKE = "Take"
    """A claim of its own component that no pod uses: take it over by compare-and-swap."""
    BUSY = "Busy"


def take_device(claim: Claim | None, *, holder: Holder, pod_uid: str) -> Take:
    """Whether this pod may have the device. Only the same uid, instance and component may ever take a claim over."""
    if claim is None:
        return Take.CREATE
    if not same_holder(claim.holder, holder):
        return Take.BUSY
    if claim.status.pod == pod_uid and not claim.draining:
        return Take.ADOPT
    return Take.TAKE if claim.draining or not claim.status.pod else Take.BUSY


class PodUse(StrEnum):
    """What the pod named in a device claim is doing."""

    NONE = "None"
    """No pod is named: just created, or waiting for a successor."""
    USES = "Uses"
    """Pending, running or terminating with the device."""
    ELSEWHERE = "Elsewhere"
    """Bound without a grant for this device (F3): it can never use it."""
    GONE = "Gone"
    """404, another uid, or ended."""


def pod_use(claim: Claim, pod: Pod | None) -> PodUse:
    if claim.draining or not claim.status.pod:
        return PodUse.NONE
    if pod is None or pod.metadata.uid != claim.status.pod or pod.terminal:
        return PodUse.GONE
    device, node = claim.spec.device, pod.spec.node_name
    if not node or device is None:
        return PodUse.USES
    granted = node == device.node and device.id in granted_devices(pod.metadata.annotations)
    return PodUse.USES if granted else PodUse.ELSEWHERE


def release_device(*, use: PodUse, wanted: bool, handed_over: bool) -> Release:
    """wanted: the app lives, is not suspended and its component still asks for devices.

    A device is never freed while its pod terminates: the driver inside may still be moving the robot.
    """
    if use is PodUse.USES:
        return Release.KEEP
    if use is PodUse.ELSEWHERE:
        return Release.DELETE
    if not wanted:
        return Release.DELETE
    if use is PodUse.GONE:
        return Release.DRAIN
    return Release.DELETE if handed_over else Release.WAIT


def wants_devices(app: App | None, holder: Holder) -> bool:
    """Whether the component of this live app still asks for exclusive devices."""
    if app is None or app.metadata.uid != holder.uid or app.spec.suspend:
        return False
    component = next((part for part in app.spec.components if part.name == holder.component), None)
    return component is not None and component.replicas > 0 and any(device.exclusive for device in component.devices)


# Which device for which requirement


def fits(requirement: Kind, device: Reported) -> bool:
    """There, and of the kind the requirement names."""
    return device.present and fits_kind(requirement, device)


def fits_kind(requirement: Kind, device: Described) -> bool:
    """Type, and model, interface and vid:pid[:serial] where the requirement names them."""
    return (
        device.type == requirement.type
        and requirement.model in {"", device.model}
        and requirement.interface in {"", device.interface}
        and (not requirement.match or identity_fits(requirement.match, device.identity))
    )


def identity_fits(match: str, identity: str) -> bool:
    """`8086:0b3a` fits `usb:8086:0B3A:123` and `8086:0b3a:123`; with a serial the serial must be equal too.

    vid:pid are hexadecimal numbers, so their case means nothing; a serial's does. Anything else must be the same text.
    """
    asked, reported = _USB_IDENTITY.fullmatch(match), _USB_IDENTITY.fullmatch(identity)
    if asked is None or reported is None:
        return match == identity
    same_model = asked[1].lower() == reported[1].lower()
    return same_model and (not asked[2] or asked[2] == reported[2])


@dataclass(frozen=True, slots=True)
class Chosen:
    """One device to be claimed for one requirement."""

    requirement: str
    id: str
    type: str
    identity: str
    path: str
    claim: str


@dataclass(frozen=True, slots=True)
class Choice:
    """Devices of one node for all exclusive requirements of a pod, sorted by claim name, or why there are none."""

    ok: bool
    devices: tuple[Chosen, ...] = ()
    reason: str = ""
    message: str = ""


def choose_devices(
    requirements: Sequence[Requirement],
    devices: Sequence[Reported],
    claims: Mapping[str, Claim],
    *,
    node: str,
    holder: Holder,
    pod_uid: str,
) -> Choice:
    """Give every requirement a device of its own, or none at all. Requirements that share only need one that fits."""
    options: list[tuple[Requirement, list[Reported]]] = []
    for requirement in requirements:
        fitting = [device for device in devices if fits(requirement, device)]
        if not fitting:
            return Choice(False, reason=Reason.WAITING_FOR_DEVICES, message=f"no {describe(requirement)} on {node}")
        if requirement.exclusive:
            mine = [d for d in fitting if _rank(d, claims, node=node, holder=holder, pod_uid=pod_uid) < BUSY_RANK]
            if not mine:
                return _busy(fitting[0], claims, node=node, holder=holder)
            mine.sort(key=lambda d: (_rank(d, claims, node=node, holder=holder, pod_uid=pod_uid), d.id))
            options.append((requirement, mine))
    found = _assign(options, frozenset())
    if found is None:
        wanted = ", ".join(describe(requirement) for requirement, _ in options)
        return Choice(False, reason=Reason.WAITING_FOR_DEVICES, message=f"not enough free devices on {node}: {wanted}")
    chosen = [_chosen(requirement, device, node) for (requirement, _), device in zip(options, found, strict=True)]
    return Choice(True, devices=tuple(sorted(chosen, key=lambda one: one.claim)))


BUSY_RANK = 3
_RANK = {Take.ADOPT: 0, Take.TAKE: 1, Take.CREATE: 2, Take.BUSY: BUSY_RANK}


def _rank(device: Reported, claims: Mapping[str, Claim], *, node: str, holder: Holder, pod_uid: str) -> int:
    return _RANK[take_device(claims.get(claim_name_device(node, device.id)), holder=holder, pod_uid=pod_uid)]


def _assign(
    options: Sequence[tuple[Requirement, list[Reported]]], used: Collection[str]
) -> tuple[Reported, ...] | None:
    """First assignment without a device twice, in order of preference. Components ask for a handful at most."""
    if not options:
        return ()
    for device in options[0][1]:
        if device.id not in used:
            rest = _assign(options[1:], {*used, device.id})
            if rest is not None:
                return (device, *rest)
    return None


def _chosen(requirement: Requirement, device: Reported, node: str) -> Chosen:
    return Chosen(
        requirement=requirement.name,
        id=device_label(device.id),
        type=device.type,
        identity=device.identity,
        path=getattr(device, "path", ""),
        claim=claim_name_device(node, device.id),
    )


def _busy(device: Reported, claims: Mapping[str, Claim], *, node: str, holder: Holder) -> Choice:
    claim = claims[claim_name_device(node, device.id)]
    return Choice(False, reason=Reason.DEVICE_BUSY, message=busy_text(claim, for_namespace=holder.namespace))


def busy_text(claim: Claim, *, for_namespace: str) -> str:
    device = claim.spec.device
    where = f"device {device.id} on {device.node}" if device else claim.name
    who = holder_text(claim.holder, for_namespace=for_namespace)
    return f"{where} is held by {who}: it is free when its holder is deleted or suspended"


def describe(requirement: Requirement) -> str:
    details = (requirement.model, requirement.interface, requirement.match or "")
    return " ".join(part for part in (requirement.type, *details) if part) + " device"
