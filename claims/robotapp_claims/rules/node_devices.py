"""Which devices a node has, and who holds them: one rule for the scheduler, the CLI and the console.

A node has the devices that its agent reports, else those that its labels name. Also which of them somebody may mean who wrote
another name.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from robotapp_api.model.names import FROM_TELEMETRY, GPU, HARDWARE_PREFIX, HARDWARE_SOURCE
from robotapp_api.values.devices.words import AGENT_TYPES, PLUGGING_ORDER, USUAL_TYPES, find_similar_type, list_types
from robotapp_claims.rules.device import Identified, Kind, is_device
from robotapp_claims.rules.identity import device_label
from robotapp_claims.rules.objects import Claim

MOST_NAMED: Final = 3
"""Devices and nodes that a message names."""
SHORTEST_SERIAL: Final = 4
"""Shorter serials occur in other texts by chance."""

# States of a device

HELD: Final = "held"
FREE: Final = "free"
ABSENT: Final = "absent"
DEVICE_PLUGIN: Final = "device plugin"
"""A GPU: its device plugin hands it out, and no claim shows to whom."""
UNKNOWN: Final = "unknown"
"""No claim that may be read holds it, and others may."""


class Device(NamedTuple):
    """A device of a node as rules see it."""

    id: str
    type: str
    model: str = ""
    interface: str = ""
    identity: str = ""
    names: tuple[str, ...] = ()


def devices_of_labels(labels: Mapping[str, str]) -> tuple[Device, ...]:
    """Devices of a node that has no telemetry: hardware.robotics.io/<type>[-<interface>]: <model or true>.

    A label without interface is a device only while no other label names one of its type: else one device had two names.
    Its model is then that of the only one there is. Labels made from telemetry are no devices: several of them mean the same
    one, and only the telemetry shows which.
    """
    if labels.get(HARDWARE_SOURCE) == FROM_TELEMETRY:
        return ()
    models: dict[str, str] = {}
    named: dict[str, list[Device]] = {}
    for key in sorted(labels):
        if key.startswith(HARDWARE_PREFIX):
            ident, value = key.removeprefix(HARDWARE_PREFIX), labels[key]
            kind, _, interface = ident.partition("-")
            model = "" if value == "true" else value
            if interface:
                named.setdefault(kind, []).append(Device(ident, kind, model, interface))
            else:
                models[kind] = model
    for kind, model in models.items():
        devices = named.setdefault(kind, [])
        if not devices:
            devices.append(Device(kind, kind, model))
        elif len(devices) == 1 and not devices[0].model:
            devices[0] = devices[0]._replace(model=model)
    return tuple(sorted(device for devices in named.values() for device in devices))


class Reported(Identified, Protocol):
    """A device with its path, as an agent reports it."""

    @property
    def path(self) -> str: ...
    @property
    def present(self) -> bool: ...


class NodeDevice(NamedTuple):
    """One device of a node. `source`: agent, label or claim, whichever names it. `is_present`: None where a claim alone names it."""

    node: str
    device: Device
    source: str
    is_present: bool | None = True
    path: str = ""
    claim: Claim | None = None
    has_hidden_claims: bool = False
    """Whether claims that may not be read may hold it."""

    @property
    def state(self) -> str:
        """Returns the word for people."""
        if self.claim is not None:
            return HELD
        if not self.is_present:
            return ABSENT
        if self.device.type == GPU:
            return DEVICE_PLUGIN
        return UNKNOWN if self.has_hidden_claims else FREE

    @property
    def holder(self) -> str:
        """Returns `namespace/name`, "" while nobody is known to hold it."""
        return f"{self.claim.holder.namespace}/{self.claim.holder.name}" if self.claim is not None else ""


def list_devices(
    labels: Mapping[str, Mapping[str, str]],
    reports: Mapping[str, Iterable[Reported]],
    claims: Iterable[Claim],
    *,
    hidden: Collection[str] = (),
) -> dict[str, tuple[NodeDevice, ...]]:
    """Returns the devices of each node that has any, with their holders. labels and reports: by node.

    claims: RobotClaims, and what ResourceClaims hold in their form (`list_held`). hidden: nodes on which claims that may not be read
    may hold devices. A held device that nothing describes is listed all the same.
    """
    claims_by_node: defaultdict[str, list[Claim]] = defaultdict(list)
    for claim in claims:
        if claim.spec.device is not None:
            claims_by_node[claim.spec.device.node].append(claim)
    devices = {
        node: [NodeDevice(node, device, "label") for device in devices_of_labels(pairs)]
        for node, pairs in labels.items()
    }
    devices |= {node: [_read_report(node, item) for item in items] for node, items in reports.items()}
    for node in devices.keys() & frozenset(hidden):
        devices[node] = [device._replace(has_hidden_claims=True) for device in devices[node]]
    return {
        node: _with_holders(node, devices.get(node, ()), claims_by_node.get(node, ()))
        for node in sorted(devices.keys() | claims_by_node.keys())
        if devices.get(node) or claims_by_node.get(node)
    }


def find_hidden_nodes(
    nodes: Iterable[str], *, claims_are_read: bool, driver_nodes: Iterable[str] | None
) -> frozenset[str]:
    """Returns the nodes on which ResourceClaims that may not be read may hold devices. driver_nodes: None where they may not be read."""
    if claims_are_read:
        return frozenset()
    return frozenset(nodes if driver_nodes is None else driver_nodes)


def _read_report(node: str, item: Reported) -> NodeDevice:
    device = Device(
        item.id, item.type, model=item.model, interface=item.interface, identity=item.identity, names=tuple(item.names)
    )
    return NodeDevice(node, device, "agent", item.present, item.path)


def _with_holders(node: str, devices: Iterable[NodeDevice], claims: Iterable[Claim]) -> tuple[NodeDevice, ...]:
    """Returns each device with the claim of its name, else with one that was made under another name and may be for it."""
    rows = list(devices)
    labels = {device_label(row.device.id) for row in rows}
    claims_by_id = {claim.spec.device.id: claim for claim in claims if claim.spec.device is not None}
    matched_claims = set[str]()
    for index, row in enumerate(rows):
        claim = claims_by_id.get(device_label(row.device.id)) or _find_alias(row.device, claims_by_id.values(), labels)
        if claim is not None:
            matched_claims.add(claim.name)
            rows[index] = row._replace(claim=claim)
    rows += [
        NodeDevice(node, Device(thing.id, thing.type), "claim", is_present=None, claim=claim)
        for claim in claims_by_id.values()
        if claim.name not in matched_claims and (thing := claim.spec.device) is not None
    ]
    return tuple(rows)


def _find_alias(device: Device, claims: Iterable[Claim], labels: set[str]) -> Claim | None:
    claimed_devices = ((claim, claim.spec.device) for claim in claims)
    return next(
        (
            claim
            for claim, claimed_device in claimed_devices
            if claimed_device is not None and is_device(claimed_device, device, known=labels)
        ),
        None,
    )


# What is there in place of a device that is not

_PUBLISHED: Final = frozenset({*AGENT_TYPES, *USUAL_TYPES}) - {"usb"}
"""Types under which no device of another type can be what was meant, unless its make is written."""


def describe_missing(wish: Kind, devices_by_node: Mapping[str, Sequence[Reported]]) -> str:
    """Returns which devices the nodes have in place of a wished-for one that none of them has, "" without any report.

    A name in the order of plugging in is no wish that may be fulfilled: the next start would take another device under it.
    """
    if not devices_by_node:
        return ""
    nodes = sorted(devices_by_node)
    places = ", ".join(nodes[:MOST_NAMED]) + (f" and {len(nodes) - MOST_NAMED} more" if len(nodes) > MOST_NAMED else "")
    start = f"no {_describe_wish(wish)} on {places}"
    present = [
        (node, device) for node in nodes for device in devices_by_node[node] if device.present and device.type != GPU
    ]
    candidates = [(node, device) for node, device in present if _is_meant(wish, device)]
    if candidates:
        return f"{start}: {_name_all(candidates)} is what that name means now; write {_cure_of(candidates[0][1])}"
    same_type = [(node, device) for node, device in present if device.type in list_types(wish.type)]
    if same_type:
        return f"{start}, but {_name_all(same_type)}; write {_cure_of(same_type[0][1])}"
    if present and wish.type.lower() in _PUBLISHED and not wish.model and not wish.usb_id:
        return f"{start}, but {_name_all(present)}; plug it in, or choose a node that has it (kubectl robotapp devices lists what agents find)"
    if present:
        return f"{start}, but {_name_all(present)}; {_hint_at(wish)}write {_cure_of(present[0][1])}, or a rule of the agent that names it {wish.type}"
    return f"{start}, which has no device; plug it in (kubectl robotapp devices lists what agents find)"


def _describe_wish(wish: Kind) -> str:
    fields = (("model", wish.model), ("interface", wish.interface), ("usbID", wish.usb_id))
    return " ".join([wish.type, *(f"{field} {text}" for field, text in fields if text)])


def _is_meant(wish: Kind, device: Reported) -> bool:
    """Returns whether a text of the wish is the device's present path, its id, or a name that udev makes of its serial."""
    serial = device.identity.partition(":")[2].partition(":")[2]
    for text in filter(None, (wish.interface, wish.model, wish.usb_id)):
        port = PLUGGING_ORDER.fullmatch(text)
        name = port[1] if port else text.rpartition("/")[2]
        if name in {device.path.rpartition("/")[2], device.id, device.id.removeprefix(f"{device.type}-")}:
            return True
        if len(serial) >= SHORTEST_SERIAL and serial in text:
            return True
    return False


def _hint_at(wish: Kind) -> str:
    """Returns a question about a type that looks like a misspelt one, "" for others."""
    near = find_similar_type(wish.type)
    return f"did you mean type: {near}? Else " if near else ""


def _name_all(places: Sequence[tuple[str, Reported]]) -> str:
    names = [
        f"{device.id}{f' ({device.path})' if device.path else ''} on {node}" for node, device in places[:MOST_NAMED]
    ]
    more = [f"{len(places) - MOST_NAMED} more"] if len(places) > MOST_NAMED else []
    names += more
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _cure_of(device: Reported) -> str:
    """Returns the fields that choose a device whatever is plugged in beside it."""
    if device.identity:
        return f'type: {device.type}, usbID: "{device.identity.removeprefix("usb:")}"'
    if device.interface:
        return f"type: {device.type}, interface: {device.interface}"
    return f"type: {device.type}, model: {device.model}" if device.model else f"type: {device.type}"
