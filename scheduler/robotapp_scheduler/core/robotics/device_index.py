"""Which devices nodes have, which are claimed or shared, and which one a pod may take.

A requirement always resolves to a device id, so that one device has one name. What is held keeps the name it was held
under, also when an agent begins or ceases to describe the node meanwhile (`claims.device.is_device`). The claims here are the watch's copy:
good enough to choose a node, never to grant (the shell's create of the RobotClaim decides).
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from robotapp_claims.rules.device import PREFERENCE, Take, assign, fits_kind, is_device, take_device
from robotapp_claims.rules.identity import UNKNOWN_DEVICE_TYPE, device_label, same_holder, shared_devices
from robotapp_claims.rules.node_devices import Device, devices_of_labels
from robotapp_claims.rules.objects import Claim, DeviceThing, TelemetryDevice
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.ros import DeviceHolder, DeviceRequest


class DeviceGrant(NamedTuple):
    """The device chosen for one request; `exclusive` ones need a RobotClaim before the bind."""

    request: str
    node: str
    device: Device
    exclusive: bool


class Busy(NamedTuple):
    """Who keeps a device from a pod: a claim's holder, or a pod that shares it with others.

    Without a namespace it is a pod that is being placed, not a claim yet, or a ResourceClaim, which `ClaimCache.find_holder` names.
    """

    device: Device
    namespace: str
    holder: str


class Use(NamedTuple):
    """A device that an assumed pod will hold (exclusive), or that a pod shares with others."""

    thing: DeviceThing
    exclusive: bool
    namespace: str
    name: str


class DeviceIndex:
    """Devices per node, their claims and shares, and devices that this process has granted and no claim shows yet."""

    def __init__(self, on_held: Callable[[DeviceThing, int], None] = lambda _thing, _sign: None) -> None:
        """on_held: called with each device that a claim or pod holds from now on (1), and that it gives back (-1)."""
        self._on_held = on_held
        self._devices: dict[str, tuple[Device, ...]] = {}
        self._with_telemetry: set[str] = set()
        self._known: dict[str, frozenset[str]] = {}
        """Labels of all ids a node reports, of devices that are not plugged in too."""
        self._claims: dict[str, dict[str, Claim]] = {}
        """Claims of a node by name."""
        self._claim_nodes: dict[str, str] = {}
        self._allocated: dict[str, set[str]] = {}
        """Labels of the devices of a node that ResourceClaims have."""
        self._uses: dict[str, dict[str, list[Use]]] = {}
        """Promises and shared uses of a node by pod uid."""
        self._use_nodes: dict[str, str] = {}
        self._capable: dict[tuple[str, str, str, str], frozenset[str]] = {}
        self._kept: Mapping[tuple[str, str], str] = {}

    def __repr__(self) -> str:
        return f"DeviceIndex({len(self._devices)} nodes, {len(self._claim_nodes)} claims, {len(self._use_nodes)} users)"

    def set_labels(self, node: str, labels: dict[str, str]) -> bool:
        """Devices by labels, used while the node has no telemetry. True when something is different."""
        if node in self._with_telemetry:
            return False
        devices = devices_of_labels(labels)
        return self._set(node, devices, known=devices)

    def set_telemetry(self, node: str, devices: Iterable[TelemetryDevice]) -> bool:
        """What the agent sees; absent devices do not count. True when something is different."""
        self._with_telemetry.add(node)
        devices = tuple(devices)
        present = (Device(d.id, d.type, d.model, d.interface, d.identity, d.names) for d in devices if d.present)
        return self._set(node, tuple(sorted(present)), known=devices)

    def drop_telemetry(self, node: str, labels: dict[str, str]) -> bool:
        """The agent's object is gone: labels count again."""
        self._with_telemetry.discard(node)
        return self.set_labels(node, labels)

    def apply_claim(self, claim: Claim) -> str | None:
        """Take in a device claim; answers the node it is on, None for a domain claim."""
        thing = claim.spec.device
        if thing is None:
            return None
        if claim.metadata.name not in self._claim_nodes:
            self._on_held(thing, 1)
        self._claims.setdefault(thing.node, {})[claim.metadata.name] = claim
        self._claim_nodes[claim.metadata.name] = thing.node
        return thing.node

    def remove_claim(self, name: str) -> str | None:
        """A claim is gone; answers the node whose device is free now."""
        node = self._claim_nodes.pop(name, None)
        if node is not None:
            thing = self._claims[node][name].spec.device
            _drop(self._claims, node, name)
            if thing is not None:
                self._on_held(thing, -1)
        return node

    def set_allocated(self, node: str, device_id: str, *, is_allocated: bool) -> None:
        """A ResourceClaim got a device of the node, or none has it any more."""
        labels = self._allocated.setdefault(node, set())
        if is_allocated:
            labels.add(device_label(device_id))
            return
        labels.discard(device_label(device_id))
        if not labels:
            del self._allocated[node]

    def assume(self, pod_uid: str, grants: Iterable[DeviceGrant], *, namespace: str = "", name: str = "") -> None:
        """Keep devices for an assumed pod: those it will hold alone, and those it will share with others."""
        for grant in grants:
            device = grant.device
            thing = DeviceThing(node=grant.node, type=device.type, id=device_label(device.id), identity=device.identity)
            shown = ("", "a pod being placed") if grant.exclusive else (namespace, name)
            self._use(pod_uid, Use(thing, grant.exclusive, *shown))

    def see(self, pod: Pod) -> None:
        """A pod on a node: its grant names what it shares, if it was bound before this process began."""
        meta = pod.metadata
        if meta.uid in self._use_nodes or not meta.annotations:
            return
        for ident in shared_devices(meta.annotations):
            thing = DeviceThing(node=pod.spec.node_name, type=UNKNOWN_DEVICE_TYPE, id=ident)
            self._use(meta.uid, Use(thing, False, meta.namespace, meta.name))

    def release(self, pod_uid: str) -> bool:
        """The pod is gone or was not bound: drop the devices assumed for it, and those it shares. Returns whether there were any."""
        node = self._use_nodes.pop(pod_uid, None)
        if node is None:
            return False
        uses = self._uses[node][pod_uid]
        _drop(self._uses, node, pod_uid)
        for use in uses:
            self._on_held(use.thing, -1)
        return True

    def of(self, node: str) -> tuple[Device, ...]:
        """Devices of a node, sorted by id."""
        return self._devices.get(node, ())

    def free_by_type(self) -> dict[str, int]:
        """Devices that are neither claimed nor granted, by type; 0 for a type that is all taken."""
        found: dict[str, int] = {}
        for node, devices in self._devices.items():
            for device in devices:
                free = (
                    not self._is_allocated(node, device)
                    and next(self._claims_on(node, device), None) is None
                    and next(self._uses_of(node, device), None) is None
                )
                found[device.type] = found.get(device.type, 0) + free
        return found

    def capable(self, request: DeviceRequest) -> frozenset[str]:
        """Names of nodes that have such a device, free or not."""
        key = (request.type, request.model, request.interface, request.usb_id)
        found = self._capable.get(key)
        if found is None:
            found = self._capable[key] = frozenset(
                node for node, devices in self._devices.items() if any(fits_kind(request, device) for device in devices)
            )
        return found

    def usable(self, request: DeviceRequest, node: str, holder: DeviceHolder) -> frozenset[int]:
        """Positions in `of(node)` of the devices that would meet this request of the holder now."""
        return frozenset(
            i
            for i, device in enumerate(self.of(node))
            if fits_kind(request, device) and self.blocker(node, device, holder, exclusive=request.exclusive) is None
        )

    def keep(self, devices: Mapping[tuple[str, str], str]) -> None:
        """While a plan is followed: by (node, device id) the pod that needs it alone, "" for several that share it.

        Others take such a device when there is no other.
        """
        self._kept = devices

    def contested(self, node: str) -> bool:
        """Whether any device of the node is claimed, assumed or shared."""
        return node in self._claims or node in self._uses or node in self._allocated

    def blocker(self, node: str, device: Device, holder: DeviceHolder, *, exclusive: bool = True) -> Busy | None:
        """Who stands in the way of this pod using the device, alone or together with others; None when it may."""
        if self._is_allocated(node, device):
            return Busy(device, "", "a ResourceClaim")
        for claim in self._claims_on(node, device):
            if claim.momentary and not exclusive:
                continue
            if take_device(claim, holder=holder, pod_uid=holder.pod_uid) is Take.BUSY:
                return Busy(device, claim.holder.namespace, claim.holder.name)
        for pod_uid, use in self._uses_of(node, device):
            if pod_uid != holder.pod_uid and (exclusive or use.exclusive):
                return Busy(device, use.namespace, use.name)
        return None

    def choose(
        self, requests: Sequence[DeviceRequest], node: str, holder: DeviceHolder
    ) -> tuple[DeviceGrant, ...] | None:
        """A different device for every exclusive request and one that no pod holds alone for every shared one.

        All or nothing; None when the node cannot give that.
        """
        devices = self.of(node)
        if sum(request.exclusive for request in requests) > len(devices):
            return None
        alike = {
            request: [i for i, device in enumerate(devices) if fits_kind(request, device)]
            for request in dict.fromkeys(requests)
        }
        fitting = [alike[request] for request in requests]
        if not all(fitting):
            return None
        asked = list(zip(requests, fitting, strict=True))
        shared = {i for request, options in asked if not request.exclusive for i in options}
        found = self._alone([options for request, options in asked if request.exclusive], node, holder, last=shared)
        if found is None:
            return None
        open_ = {i for i in shared.difference(found) if self.blocker(node, devices[i], holder, exclusive=False) is None}
        alone = [devices[i] for i in found]
        names = self._names(node, alone, holder)
        held = (device._replace(id=name) for device, name in zip(alone, names, strict=True))
        grants = list[DeviceGrant]()
        for request, options in asked:
            if request.exclusive:
                device: Device | None = next(held)
            else:  # one entry with a count shares as many different devices; two entries may share one
                same = {grant.device for grant in grants if grant.request == request.name}
                device = self._to_share(node, [devices[i] for i in options if i in open_ and devices[i] not in same])
            if device is None:
                return None
            grants.append(DeviceGrant(request.name, node, device, request.exclusive))
        return tuple(grants)

    def _alone(
        self, fitting: Sequence[Sequence[int]], node: str, holder: DeviceHolder, *, last: Collection[int]
    ) -> Sequence[int] | None:
        """Positions of the devices that exclusive requests get, each from its `fitting` ones; None when they cannot all have one.

        last: devices that are taken when there is no other, as are those that other pods of a plan need.
        """
        if not fitting:
            return ()
        devices = self.of(node)
        kept = {i for i, device in enumerate(devices if self._kept else ()) if self._is_kept(node, device, holder)}
        return assign(fitting, preferred=self._preferred(devices, node, holder, last={*last, *kept}))

    def _is_kept(self, node: str, device: Device, holder: DeviceHolder) -> bool:
        """For another pod than this one?"""
        return self._kept.get((node, device.id), holder.pod_uid) != holder.pod_uid

    def _to_share(self, node: str, devices: Sequence[Device]) -> Device | None:
        """Rather one that is shared already: the others stay free for pods that need one alone."""
        return min(
            devices,
            key=lambda device: (
                bool(self._kept.get((node, device.id))),
                next(self._uses_of(node, device), None) is None,
            ),
            default=None,
        )

    def _names(self, node: str, devices: Sequence[Device], holder: DeviceHolder) -> list[str]:
        """The id to claim each device under: the one under which this holder has it already, else its own."""
        names, taken = [], set[str]()
        for device in devices:
            mine = (claim.spec.device for claim in self._claims_on(node, device) if same_holder(claim.holder, holder))
            held = {thing.id for thing in mine if thing} - taken
            label = device_label(device.id)
            names.append(device.id if label in held or not held else min(held))
            taken.add(device_label(names[-1]))
        return names

    def blockers(self, requests: Sequence[DeviceRequest], node: str, holder: DeviceHolder) -> tuple[Busy, ...]:
        """For the event: every matching but taken device of a node."""
        found = (
            self.blocker(node, device, holder, exclusive=request.exclusive)
            for request in requests
            for device in self.of(node)
            if fits_kind(request, device)
        )
        return tuple(busy for busy in found if busy is not None)

    def _preferred(
        self, devices: Sequence[Device], node: str, holder: DeviceHolder, *, last: Collection[int]
    ) -> list[int]:
        """Devices that are free for this holder; those it has or inherits come first, or a retry would collect more.

        last: devices that its own shared requests could use, or that others need, taken when there is no other.
        """
        free = [i for i, device in enumerate(devices) if self.blocker(node, device, holder) is None]
        if not self.contested(node) and not last:
            return free
        return sorted(free, key=lambda i: (self._rank(node, devices[i], holder), i in last))

    def _rank(self, node: str, device: Device, holder: DeviceHolder) -> int:
        found = (take_device(claim, holder=holder, pod_uid=holder.pod_uid) for claim in self._claims_on(node, device))
        return min((PREFERENCE[take] for take in found), default=PREFERENCE[Take.CREATE])

    def _is_allocated(self, node: str, device: Device) -> bool:
        return node in self._allocated and device_label(device.id) in self._allocated[node]

    def _claims_on(self, node: str, device: Device) -> Iterator[Claim]:
        """Claims that hold this device, under whatever id."""
        known = self._known.get(node, frozenset())
        for claim in self._claims.get(node, {}).values():
            if claim.spec.device is not None and is_device(claim.spec.device, device, known=known):
                yield claim

    def _uses_of(self, node: str, device: Device) -> Iterator[tuple[str, Use]]:
        """Promises and shared uses of this device, with the pod's uid."""
        known = self._known.get(node, frozenset())
        for pod_uid, uses in self._uses.get(node, {}).items():
            for use in uses:
                if is_device(use.thing, device, known=known):
                    yield pod_uid, use

    def _use(self, pod_uid: str, use: Use) -> None:
        node = use.thing.node
        self._use_nodes[pod_uid] = node
        self._on_held(use.thing, 1)
        self._uses.setdefault(node, {}).setdefault(pod_uid, []).append(use)

    def _set(self, node: str, devices: tuple[Device, ...], *, known: Iterable[Device | TelemetryDevice]) -> bool:
        labels = frozenset(device_label(device.id) for device in known)
        if self._devices.get(node, ()) == devices and self._known.get(node, frozenset()) == labels:
            return False
        self._capable.clear()
        self._known[node] = labels
        if not labels:
            del self._known[node]
        if devices:
            self._devices[node] = devices
        else:
            self._devices.pop(node, None)
        return True


def _drop(table: dict[str, dict[str, Any]], node: str, key: str) -> None:
    found = table.get(node, {})
    found.pop(key, None)
    if not found:
        table.pop(node, None)
