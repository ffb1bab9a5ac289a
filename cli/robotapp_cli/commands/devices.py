"""`devices`: which devices nodes have, and who holds them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import msgspec

from robotapp_api.model.names import GPU
from robotapp_claims.rules.device import is_device
from robotapp_claims.rules.device_attributes import list_held
from robotapp_claims.rules.identity import device_label
from robotapp_claims.rules.node_devices import Device, devices_of_labels
from robotapp_claims.rules.objects import DeviceThing, ResourceClaim
from robotapp_cli.output import Column, Output, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json, meta, status
from robotapp_cli.reading.session import Session
from robotapp_client import ApiClient, Forbidden, NotFound
from robotapp_client.api.resources import NODES, NODETELEMETRIES, RESOURCECLAIMS, ROBOTCLAIMS

_NO_CLAIM: Final = ("holder", "instance", "component", "phase", "claim")


@dataclass(frozen=True, slots=True)
class NodeDevice:
    """One device of a node. `source`: agent, label or claim, whichever names it."""

    node: str
    device: Device
    source: str
    present: str = "yes"
    path: str = ""
    claim: Json | None = None

    @property
    def state(self) -> str:
        """What counts it: held, free, or neither."""
        if self.claim is not None:
            return "held"
        return "free" if self.present == "yes" and self.device.type != GPU else ""

    @property
    def row(self) -> dict[str, str]:
        found = {"node": self.node, "device": self.device.id, "present": self.present, "source": self.source}
        found |= {key: getattr(self.device, key) for key in ("type", "model", "interface")}
        found |= {"names": ",".join(self.device.names), "path": self.path}
        return found | _claim_fields(self.claim)


async def show_devices(session: Session) -> None:
    """Every device of every node, with its holder."""
    claims = await list_device_claims(session.client)
    telemetry = (await session.client.list(NODETELEMETRIES)).items
    found = devices_of((await session.client.list(NODES)).items, telemetry, claims)
    rows = [each.row for devices in found.values() for each in devices]
    if namespace := session.options.namespace:
        rows = [row for row in rows if not row["holder"] or row["holder"].startswith(f"{namespace}/")]
    rows.sort(key=lambda row: (row["node"], row["device"]))
    if session.options.output.structured:
        write_structured({"devices": rows}, session.options.output)
        return
    if not rows:
        print_line(
            "No node has a device. They are reported by the node agents (kubectl get nodetelemetries) or named by labels hardware.robotics.io/<type>[-<interface>].",
        )
        return
    keys = ["node", "device", "type", "model", "interface", "present", "holder", "instance", "component", "phase"]
    wide = session.options.output is Output.WIDE
    keys = [*keys, "names", "source", "claim", "path"] if wide else [key for key in keys if _tells(key, rows)]
    columns = [Column(key.upper(), wraps=key in ("names", "path")) for key in keys]
    print_table(columns, [[_cell(key, row) for key in keys] for row in rows])


async def list_device_claims(client: ApiClient) -> list[Json]:
    """Returns RobotClaims, and devices that ResourceClaims hold in the same form: where the driver runs these are the ledger.

    ResourceClaims are left out where the API server has none, or the user may not list them.
    """
    claims = (await client.list(ROBOTCLAIMS)).items
    try:
        resource_claims = (await client.list(RESOURCECLAIMS, as_type=ResourceClaim)).items
    except (NotFound, Forbidden):
        return claims
    held = [claim for resource_claim in resource_claims for claim in list_held(resource_claim)]
    return [*claims, *(msgspec.to_builtins(claim) for claim in held)]


def devices_of(nodes: Iterable[Json], telemetry: Iterable[Json], claims: Iterable[Json]) -> dict[str, list[NodeDevice]]:
    """By node. Where an agent reports, its devices count, else those of the node's labels, as for the scheduler.

    A held device of which nothing else is known is there as well: what described it is gone, and its claim is not.
    """
    found = {meta(node)["name"]: _labelled(node) for node in nodes}
    found |= {meta(each)["name"]: _reported(each) for each in telemetry}
    held: dict[str, list[Json]] = {}
    for claim in claims:
        if "device" in claim["spec"]:
            held.setdefault(claim["spec"]["device"]["node"], []).append(claim)
    for node, claimed in held.items():
        found[node] = _with_holders(node, found.get(node, []), claimed)
    return found


def _labelled(node: Json) -> list[NodeDevice]:
    labels = meta(node).get("labels") or {}
    return [NodeDevice(meta(node)["name"], device, "label") for device in devices_of_labels(labels)]


def _reported(telemetry: Json) -> list[NodeDevice]:
    node = meta(telemetry)["name"]
    return [
        NodeDevice(
            node,
            Device(
                item["id"],
                item["type"],
                model=item.get("model", ""),
                interface=item.get("interface", ""),
                identity=item.get("identity", ""),
                names=tuple(item.get("names") or ()),
            ),
            "agent",
            "yes" if item.get("present") else "no",
            item.get("path", ""),
        )
        for item in status(telemetry).get("devices") or []
    ]


def _with_holders(node: str, devices: list[NodeDevice], claims: list[Json]) -> list[NodeDevice]:
    """Each device with the claim of its name, else with one that was made under another name and may be for it."""
    things = [(msgspec.convert(claim["spec"]["device"], DeviceThing), claim) for claim in claims]
    known = {device_label(each.device.id) for each in devices}
    exact = {thing.id: claim for thing, claim in things}
    found, seen = [], set[str]()
    for each in devices:
        claim = exact.get(device_label(each.device.id)) or next(
            (claim for thing, claim in things if is_device(thing, each.device, known=known)), None
        )
        found.append(
            each if claim is None else NodeDevice(node, each.device, each.source, each.present, each.path, claim)
        )
        seen |= set() if claim is None else {meta(claim)["name"]}
    unseen = [(thing, claim) for thing, claim in things if meta(claim)["name"] not in seen]
    return [
        *found,
        *(NodeDevice(node, Device(thing.id, thing.type), "claim", "unknown", claim=claim) for thing, claim in unseen),
    ]


def _tells(key: str, rows: list[dict[str, str]]) -> bool:
    """Is the column worth its width? Models and interfaces where there are any, presence where something is missing."""
    usual = {"model": "", "interface": "", "present": "yes"}
    return key not in usual or any(row[key] != usual[key] for row in rows)


def _cell(key: str, row: Mapping[str, str]) -> str:
    if key != "holder" or row[key]:
        return row[key]
    return "device plugin" if row["type"] == GPU else "free"


def holder_of(claim: Json) -> tuple[str, str, str]:
    """`namespace/name`, instance and component."""
    holder = claim["spec"]["holder"]
    return f"{holder['namespace']}/{holder['name']}", holder.get("instance", ""), holder.get("component", "")


def _claim_fields(claim: Json | None) -> dict[str, str]:
    if claim is None:
        return dict.fromkeys(_NO_CLAIM, "")
    values = (*holder_of(claim), status(claim).get("phase", ""), meta(claim)["name"])
    return dict(zip(_NO_CLAIM, values, strict=True))
