"""Which devices nodes have, which are claimed, and which one a pod may take.

A requirement always resolves to a device id, so that one device has one name. The claims here are the watch's copy:
good enough to choose a node, never to grant (the shell's create of the RobotClaim decides).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from robotapp_api.claims.device import PREFERENCE, Take, assign, fits_kind, take_device
from robotapp_api.claims.identity import device_label
from robotapp_api.claims.objects import Claim, TelemetryDevice
from robotapp_api.model.names import HARDWARE_PREFIX
from robotapp_scheduler.core.ros import DeviceHolder, DeviceWish


class Device(NamedTuple):
    """A device of a node as rules see it."""

    id: str
    type: str
    model: str = ""
    interface: str = ""
    identity: str = ""


class DeviceGrant(NamedTuple):
    """The device chosen for one wish; `exclusive` ones need a RobotClaim before the bind."""

    wish: str
    node: str
    device: Device
    exclusive: bool


class Busy(NamedTuple):
    """Who keeps a device from a pod; without a namespace it is a pod that is being placed, not a claim yet."""

    device: Device
    namespace: str
    holder: str


def devices_of_labels(labels: dict[str, str]) -> tuple[Device, ...]:
    """Devices of a node that has no telemetry: hardware.robotics.io/<type>[-<interface>]: <model or true>."""
    found = []
    for key in sorted(labels):
        if key.startswith(HARDWARE_PREFIX):
            ident = key.removeprefix(HARDWARE_PREFIX)
            kind, _, interface = ident.partition("-")
            value = labels[key]
            found.append(Device(id=ident, type=kind, model="" if value == "true" else value, interface=interface))
    return tuple(found)


class DeviceIndex:
    """Devices per node, claims per device, and what this process has promised but not yet seen as a claim."""

    def __init__(self) -> None:
        self._devices: dict[str, tuple[Device, ...]] = {}
        self._with_telemetry: set[str] = set()
        # Claims and promises are kept under the label of the device's id, which is how claims name it.
        self._claims: dict[tuple[str, str], Claim] = {}
        self._claim_names: dict[str, tuple[str, str]] = {}
        self._promised: dict[tuple[str, str], str] = {}
        self._contested: dict[str, int] = {}
        self._capable: dict[tuple[str, str, str, str], frozenset[str]] = {}

    def __repr__(self) -> str:
        return f"DeviceIndex({len(self._devices)} nodes, {len(self._claims)} claims, {len(self._promised)} promised)"

    def set_labels(self, node: str, labels: dict[str, str]) -> bool:
        """Labels say what a node has only while no telemetry does. True when something is different."""
        if node in self._with_telemetry:
            return False
        return self._set(node, devices_of_labels(labels))

    def set_telemetry(self, node: str, devices: Iterable[TelemetryDevice]) -> bool:
        """What the agent sees; absent devices do not count. True when something is different."""
        self._with_telemetry.add(node)
        present = (Device(d.id, d.type, d.model, d.interface, d.identity) for d in devices if d.present)
        return self._set(node, tuple(sorted(present)))

    def drop_telemetry(self, node: str, labels: dict[str, str]) -> bool:
        """The agent's object is gone: labels count again."""
        self._with_telemetry.discard(node)
        return self.set_labels(node, labels)

    def apply_claim(self, claim: Claim) -> str | None:
        """Take in a device claim; answers the node it is on, None for a domain claim."""
        thing = claim.spec.device
        if thing is None:
            return None
        key = (thing.node, device_label(thing.id))
        if key not in self._claims:
            self._contest(thing.node, +1)
        self._claims[key] = claim
        self._claim_names[claim.metadata.name] = key
        return thing.node

    def remove_claim(self, name: str) -> str | None:
        """A claim is gone; answers the node whose device is free now."""
        key = self._claim_names.pop(name, None)
        if key is None:
            return None
        if self._claims.pop(key, None) is not None:
            self._contest(key[0], -1)
        return key[0]

    def promise(self, pod_uid: str, grants: Iterable[DeviceGrant]) -> None:
        """Keep devices for an assumed pod until its claims are seen or it is forgotten."""
        for grant in grants:
            if grant.exclusive:
                key = (grant.node, device_label(grant.device.id))
                if key not in self._promised:
                    self._contest(grant.node, +1)
                self._promised[key] = pod_uid

    def release(self, pod_uid: str) -> None:
        """Drop all promises to a pod."""
        for key in [key for key, uid in self._promised.items() if uid == pod_uid]:
            del self._promised[key]
            self._contest(key[0], -1)

    def of(self, node: str) -> tuple[Device, ...]:
        """Devices of a node, sorted by id."""
        return self._devices.get(node, ())

    def free_by_type(self) -> dict[str, int]:
        """Devices nobody has claimed or was promised, by type; 0 for a type that is all taken."""
        found: dict[str, int] = {}
        for node, devices in self._devices.items():
            for device in devices:
                key = (node, device_label(device.id))
                taken = key in self._claims or key in self._promised
                found[device.type] = found.get(device.type, 0) + (not taken)
        return found

    def capable(self, wish: DeviceWish) -> frozenset[str]:
        """Names of nodes that have such a device, free or not."""
        key = (wish.type, wish.model, wish.interface, wish.usb_id)
        found = self._capable.get(key)
        if found is None:
            found = self._capable[key] = frozenset(
                node for node, devices in self._devices.items() if any(fits_kind(wish, device) for device in devices)
            )
        return found

    def contested(self, node: str) -> bool:
        """Is any device of the node claimed or promised?"""
        return node in self._contested

    def blocker(self, node: str, device: Device, holder: DeviceHolder) -> Busy | None:
        """Who stands in the way of this holder taking the device; None when it is free for it."""
        key = (node, device_label(device.id))
        claim = self._claims.get(key)
        if claim is not None and take_device(claim, holder=holder, pod_uid=holder.pod_uid) is Take.BUSY:
            return Busy(device, claim.holder.namespace, claim.holder.name)
        promised = self._promised.get(key)
        if promised is not None and promised != holder.pod_uid:
            return Busy(device, "", "a pod being placed")
        return None

    def choose(self, wishes: Sequence[DeviceWish], node: str, holder: DeviceHolder) -> tuple[DeviceGrant, ...] | None:
        """A different device for every exclusive wish, all or nothing; None when the node cannot give that."""
        devices = self.of(node)
        fitting = [[i for i, device in enumerate(devices) if fits_kind(wish, device)] for wish in wishes]
        if not all(fitting):
            return None
        own = [options for wish, options in zip(wishes, fitting, strict=True) if wish.exclusive]
        found = assign(own, preferred=self._preferred(devices, node, holder)) if own else []
        if found is None:
            return None
        claimed = iter(found)
        return tuple(
            DeviceGrant(wish.name, node, devices[next(claimed) if wish.exclusive else options[0]], wish.exclusive)
            for wish, options in zip(wishes, fitting, strict=True)
        )

    def blockers(self, wishes: Sequence[DeviceWish], node: str, holder: DeviceHolder) -> tuple[Busy, ...]:
        """For the event: every matching but taken device of a node."""
        found = (
            self.blocker(node, device, holder)
            for wish in wishes
            if wish.exclusive
            for device in self.of(node)
            if fits_kind(wish, device)
        )
        return tuple(busy for busy in found if busy is not None)

    def _preferred(self, devices: Sequence[Device], node: str, holder: DeviceHolder) -> list[int]:
        """Devices that are free for this holder; those it has or inherits come first, or a retry would collect more."""
        free = [i for i, device in enumerate(devices) if self.blocker(node, device, holder) is None]
        if not self.contested(node):
            return free
        return sorted(free, key=lambda i: PREFERENCE[self._take(node, devices[i], holder)])

    def _take(self, node: str, device: Device, holder: DeviceHolder) -> Take:
        claim = self._claims.get((node, device_label(device.id)))
        return take_device(claim, holder=holder, pod_uid=holder.pod_uid)

    def _contest(self, node: str, sign: int) -> None:
        count = self._contested.get(node, 0) + sign
        if count:
            self._contested[node] = count
        else:
            self._contested.pop(node, None)

    def _set(self, node: str, devices: tuple[Device, ...]) -> bool:
        if self._devices.get(node, ()) == devices:
            return False
        self._capable.clear()
        if devices:
            self._devices[node] = devices
        else:
            self._devices.pop(node, None)
        return True
