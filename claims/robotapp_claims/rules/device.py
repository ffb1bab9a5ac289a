"""Devices: what fits a requirement, which pod may take it, when it is released.

A device claim belongs to app uid + instance + component and is used by one pod (`status.pod`). When that pod is gone the
claim waits, Draining, for a successor of the same component, so a restarted driver gets its own camera back.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple, Protocol

from robotapp_api.model.names import GPU
from robotapp_api.values.devices.words import list_interfaces, list_models, list_types
from robotapp_claims.rules.identity import (
    UNKNOWN_DEVICE_TYPE,
    Owner,
    claim_name_device,
    device_label,
    granted_devices,
    holder_text,
    same_holder,
)
from robotapp_claims.rules.objects import EXCLUSIVE, App, Claim, DeviceThing, Holder, Pod
from robotapp_claims.rules.release import Release

USB: Final = "usb"
"""A type that devices of other types go by as well: a camera that an agent reports as video may be what a label calls usb."""
USB_IDENTITY: Final = re.compile(
    r"(?:usb:)?(?:0x)?(?P<vendor>[0-9a-f]{4}):(?:0x)?(?P<product>[0-9a-f]{4})(?::(?P<serial>.*))?",
    re.IGNORECASE | re.DOTALL,
)


class Kind(Protocol):
    """What a device must be. Empty fields accept anything."""

    @property
    def type(self) -> str: ...
    @property
    def model(self) -> str: ...
    @property
    def interface(self) -> str: ...
    @property
    def usb_id(self) -> str | None: ...


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
    @property
    def names(self) -> tuple[str, ...]: ...


class Identified(Described, Protocol):
    """With the id it has on its node."""

    @property
    def id(self) -> str: ...


class Asked(Protocol):
    """A request of a component's spec."""

    @property
    def type(self) -> str: ...
    @property
    def sharing(self) -> str: ...
    @property
    def count(self) -> int: ...


class Reported(Described, Protocol):
    """A device as the node's agent reports it (NodeTelemetry)."""

    @property
    def present(self) -> bool: ...


class Take(StrEnum):
    """What a pod may do about one device; what it would rather take comes first."""

    ADOPT = "Adopt"
    """It has the claim already (an earlier attempt): touch it."""
    TAKE = "Take"
    """A claim of its own component that no pod uses: take it over by compare-and-swap."""
    CREATE = "Create"
    BUSY = "Busy"


PREFERENCE: Final = {take: rank for rank, take in enumerate(Take)}


def take_device(claim: Claim | None, *, holder: Owner, pod_uid: str) -> Take:
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
    """wanted: the app lives, is not suspended and its component still requests devices.

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
    """Whether the component of this live app still requests exclusive devices."""
    if app is None or app.metadata.uid != holder.uid or app.spec.suspend:
        return False
    component = app.spec.find_component(holder.component)
    return component is not None and component.replicas > 0 and any(claimed(device) for device in component.devices)


def claimed(device: Asked) -> bool:
    """Whether our scheduler makes a claim for the device. Shared ones must be there; GPUs are given by their device plugin."""
    return device.sharing == EXCLUSIVE and device.type != GPU


def claims_wanted(devices: Iterable[Asked]) -> int:
    """How many device claims one replica of a component with these devices takes."""
    return sum(device.count for device in devices if claimed(device))


# One device, one identity


def is_device(thing: DeviceThing, device: Identified, *, known: Collection[str]) -> bool:
    """Whether `thing`, which a claim or a pod names, is this device of the same node.

    known: labels of all ids that the node reports now, plugged in or not. What is held under one of them is that device.
    What is held under another id was named when something else described the node, a label or an agent, and may be any
    device that is not surely another one: a new description of the node must not make a held device free.
    """
    if thing.id == device_label(device.id):
        return True
    return thing.id not in known and not _surely_another(thing, device)


def _surely_another(thing: DeviceThing, device: Identified) -> bool:
    if thing.type == UNKNOWN_DEVICE_TYPE:
        return False
    names = (name.partition("-") for name in device.names)
    interfaces = [interface for kind, _, interface in names if kind == thing.type]
    if thing.type == device.type or (device.type == USB and thing.identity):
        interfaces.append(device.interface or _stable_name(device.id, device.type))
    if not interfaces:
        return True
    if thing.identity and device.identity:
        # Two that are distinguished by vendor, product and serial; of one model without serials each has an id of its own.
        return not (_serial(thing.identity) and identity_fits(thing.identity, device.identity))
    if thing.identity or device.identity:
        return False
    # Ids are `<type>-<stable name>`. A label without interface, such as hardware.robotics.io/can, names no device.
    one = _stable_name(thing.id, thing.type)
    return bool(one) and all(interfaces) and one not in interfaces


def _stable_name(device_id: str, device_type: str) -> str:
    return "" if device_id == device_type else device_id.removeprefix(f"{device_type}-")


def _serial(identity: str) -> str:
    parts = split_identity(identity)
    return parts.serial if parts else identity


# Which device for which requirement


def fits(requirement: Kind, device: Reported) -> bool:
    """There, and of the kind the requirement names."""
    return device.present and fits_kind(requirement, device)


def fits_kind(requirement: Kind, device: Described) -> bool:
    """Type, and model, interface and vid:pid[:serial] where the requirement names them, in the words of people or of agents."""
    return (
        (not requirement.model or device.model in list_models(requirement.model))
        and any(
            _fits_words(device, kind, interface)
            for kind in list_types(requirement.type)
            for interface in list_interfaces(requirement.interface)
        )
        and (not requirement.usb_id or identity_fits(requirement.usb_id, device.identity))
    )


def _fits_words(device: Described, kind: str, interface: str) -> bool:
    if device.type == kind and interface in {"", device.interface}:
        return True
    return any(_fits_name(name, kind, interface) for name in device.names)


def _fits_name(name: str, kind: str, interface: str) -> bool:
    """A further name is matched as the label hardware.robotics.io/<name> is: with the interface, or any of its type."""
    if interface:
        return name == f"{kind}-{interface}"
    return name == kind or name.startswith(f"{kind}-")


def identity_fits(usb_id: str, identity: str) -> bool:
    """`8086:0b3a` fits `usb:8086:0B3A:123` and `8086:0b3a:123`; with a serial the serial must be equal too.

    vid:pid are hexadecimal numbers, so their case and a leading 0x mean nothing; a serial's case does. Anything else must be the
    same text.
    """
    wanted_id, reported = split_identity(usb_id), split_identity(identity)
    if wanted_id is None or reported is None:
        return usb_id == identity
    return wanted_id[:2] == reported[:2] and wanted_id.serial in {"", reported.serial}


class UsbIdentity(NamedTuple):
    """Vendor and product as hexadecimal digits in lower case; the serial as it is, "" without one."""

    vendor: str
    product: str
    serial: str


def split_identity(text: str) -> UsbIdentity | None:
    """Returns the parts of vid:pid[:serial], with or without 0x and the prefix usb:; None for another text."""
    parts = USB_IDENTITY.fullmatch(text)
    return UsbIdentity(parts["vendor"].lower(), parts["product"].lower(), parts["serial"] or "") if parts else None


@dataclass(frozen=True, slots=True)
class Chosen:
    """One device to be claimed. `id` is the label claims name it by."""

    id: str
    type: str
    identity: str
    claim: str


def chosen(*, node: str, device_id: str, device_type: str, identity: str) -> Chosen:
    """The device `device_id` of `node`, with the name of its claim."""
    return Chosen(device_label(device_id), device_type, identity, claim_name_device(node, device_id))


def assign(fitting: Sequence[Collection[int]], *, preferred: Iterable[int]) -> list[int] | None:
    """A device of its own for every request, or None. fitting: per request the devices that would do.

    preferred: devices one may take, best first. Each finds a place if rearranging the earlier ones makes room for it, and
    none is given up again: no other assignment uses better devices, so a retry never collects a second one.
    """
    taken: dict[int, int] = {}
    for device in preferred:
        if len(taken) == len(fitting):
            break
        _place(device, fitting, taken, set())
    return [taken[request] for request in range(len(fitting))] if len(taken) == len(fitting) else None


def _place(device: int, fitting: Sequence[Collection[int]], taken: dict[int, int], tried: set[int]) -> bool:
    """Augmenting path of a bipartite matching: `taken` maps request to device."""
    for request, devices in enumerate(fitting):
        if device in devices and request not in tried:
            tried.add(request)
            if request not in taken or _place(taken[request], fitting, taken, tried):
                taken[request] = device
                return True
    return False


def busy_text(claim: Claim, *, for_namespace: str) -> str:
    device = claim.spec.device
    where = f"device {device.id} on {device.node}" if device else claim.name
    holder = holder_text(claim.holder, for_namespace=for_namespace)
    return f"{where} is held by {holder}: it is free when its holder is deleted or suspended"
