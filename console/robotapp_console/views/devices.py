"""The devices of nodes and who holds them, by the rule of `kubectl robotapp devices`."""

from collections.abc import Iterable
from dataclasses import dataclass

from robotapp_claims.rules import node_devices
from robotapp_claims.rules.device_attributes import list_held
from robotapp_claims.rules.node_devices import FREE, find_hidden_nodes, list_devices
from robotapp_claims.rules.objects import Claim
from robotapp_console.views.snapshot import Refusal, Snapshot
from robotapp_console.views.texts import clean


@dataclass(frozen=True, slots=True)
class NodeDevice:
    """One device. `holder` is `namespace/app component`, empty while nobody is known to hold it; `state` is the word for people."""

    id: str
    type: str
    present: bool = True
    holder: str = ""
    state: str = FREE

    @property
    def is_free(self) -> bool:
        return self.state == FREE


def devices_by_node(snapshot: Snapshot) -> dict[str, tuple[NodeDevice, ...]]:
    """Returns the devices of each node with their holders, by RobotClaims and ResourceClaims."""
    devices = list_devices(
        {name: node.labels for name, node in snapshot.nodes.items()},
        {name: report.status.devices for name, report in snapshot.telemetry.items()},
        list_device_claims(snapshot),
        hidden=find_hidden(snapshot),
    )
    return {node: tuple(map(_describe, group)) for node, group in devices.items()}


def list_device_claims(snapshot: Snapshot) -> tuple[Claim, ...]:
    """Returns what holds devices, in the form of RobotClaims."""
    reserved = (claim for claim in snapshot.claims.values() if claim.spec.device is not None)
    return (*reserved, *(claim for item in snapshot.resource_claims.values() for claim in list_held(item)))


def find_hidden(snapshot: Snapshot) -> frozenset[str]:
    """Returns the nodes on which claims that the user may not read may hold devices: such devices are not shown as free."""
    if "robotclaims" in snapshot.refusals:
        return frozenset(snapshot.nodes.keys() | snapshot.telemetry.keys())
    may_read_slices = "resourceslices" not in snapshot.refusals
    return find_hidden_nodes(
        snapshot.nodes.keys() | snapshot.telemetry.keys(),
        claims_are_read="resourceclaims" not in snapshot.refusals,
        driver_nodes=(item.spec.node_name for item in snapshot.slices.values()) if may_read_slices else None,
    )


def list_ledger_refusals(snapshot: Snapshot) -> tuple[Refusal, ...]:
    """Returns which claims of devices are missing from what is shown; none of a ledger that no node has."""
    hidden = ("resourceclaims",) if find_hidden(snapshot) else ()
    return snapshot.list_refusals("robotclaims", *hidden)


def count_devices(devices: Iterable[NodeDevice]) -> tuple[int, int]:
    """Returns how many are held and how many are free."""
    group = tuple(devices)
    return sum(bool(device.holder) for device in group), sum(device.is_free for device in group)


def _describe(device: node_devices.NodeDevice) -> NodeDevice:
    component = device.claim.holder.component if device.claim is not None else ""
    holder = " ".join(part for part in (device.holder, component) if part)
    return NodeDevice(
        clean(device.device.id, 63), device.device.type, bool(device.is_present), clean(holder, 160), device.state
    )
