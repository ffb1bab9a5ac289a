"""The devices of nodes and who holds them: one rule with `kubectl robotapp devices`."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from robotapp_api.model.names import GPU
from robotapp_claims.rules.device import is_device
from robotapp_claims.rules.identity import device_label
from robotapp_claims.rules.node_devices import Device, devices_of_labels
from robotapp_claims.rules.objects import Claim
from robotapp_console.views.objects import Node, Telemetry
from robotapp_console.views.texts import clean


@dataclass(frozen=True, slots=True)
class NodeDevice:
    """One device. `holder` is `namespace/app component`, empty while it is free."""

    id: str
    type: str
    present: bool = True
    holder: str = ""

    @property
    def is_free(self) -> bool:
        return not self.holder and self.present and self.type != GPU


def devices_by_node(
    nodes: Mapping[str, Node], telemetry: Mapping[str, Telemetry], claims: Iterable[Claim]
) -> dict[str, tuple[NodeDevice, ...]]:
    """Returns the devices of each node: those its agent reports, else those of its labels, and held ones that are neither."""
    claims_by_node: dict[str, list[Claim]] = defaultdict(list)
    for claim in claims:
        if claim.spec.device is not None:
            claims_by_node[claim.spec.device.node].append(claim)
    devices = {name: [(device, True) for device in devices_of_labels(node.labels)] for name, node in nodes.items()}
    devices |= {name: _list_reported(report) for name, report in telemetry.items()}
    return {
        name: _with_holders(devices.get(name, []), claims_by_node.get(name, ()))
        for name in sorted(devices.keys() | claims_by_node.keys())
        if devices.get(name) or claims_by_node.get(name)
    }


def count_devices(devices: Iterable[NodeDevice]) -> tuple[int, int]:
    """Returns how many are held and how many are free."""
    group = tuple(devices)
    return sum(bool(device.holder) for device in group), sum(device.is_free for device in group)


def _list_reported(report: Telemetry) -> list[tuple[Device, bool]]:
    return [
        (
            Device(
                item.id, item.type, model=item.model, interface=item.interface, identity=item.identity, names=item.names
            ),
            item.present,
        )
        for item in report.status.devices
    ]


def _with_holders(devices: Iterable[tuple[Device, bool]], claims: Iterable[Claim]) -> tuple[NodeDevice, ...]:
    """Returns each device with the claim of its name, else with one that was made under another name and may be for it."""
    pairs = tuple(devices)
    claims_by_id = {claim.spec.device.id: claim for claim in claims if claim.spec.device is not None}
    labels = {device_label(device.id) for device, _ in pairs}
    rows, matched_claims = [], set[str]()
    for device, present in pairs:
        claim = claims_by_id.get(device_label(device.id)) or _find_alias(device, claims_by_id.values(), labels)
        if claim is not None:
            matched_claims.add(claim.name)
        rows.append(
            NodeDevice(clean(device.id, 63), device.type, present, _describe_holder(claim) if claim is not None else "")
        )
    rows += [
        NodeDevice(
            device_id,
            claim.spec.device.type if claim.spec.device else "",
            present=False,
            holder=_describe_holder(claim),
        )
        for device_id, claim in claims_by_id.items()
        if claim.name not in matched_claims
    ]
    return tuple(rows)


def _find_alias(device: Device, claims: Iterable[Claim], labels: set[str]) -> Claim | None:
    candidates = (claim for claim in claims if claim.spec.device is not None)
    return next(
        (claim for claim in candidates if claim.spec.device and is_device(claim.spec.device, device, known=labels)),
        None,
    )


def _describe_holder(claim: Claim) -> str:
    holder = claim.spec.holder
    parts = [f"{holder.namespace}/{holder.name}", holder.component]
    return clean(" ".join(part for part in parts if part), 160)
