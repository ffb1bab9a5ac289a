"""`devices`: which devices nodes have, and who holds them."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec

from robotapp_claims.rules.device_attributes import DRIVER, list_held
from robotapp_claims.rules.node_devices import UNKNOWN, NodeDevice, find_hidden_nodes, list_devices
from robotapp_claims.rules.objects import Claim, ResourceClaim, ResourceSlice, TelemetryDevice
from robotapp_cli.output import Column, Output, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json, meta, status
from robotapp_cli.reading.session import Session
from robotapp_client import ApiClient, Forbidden, NotFound
from robotapp_client.api.resources import NODES, NODETELEMETRIES, RESOURCECLAIMS, RESOURCESLICES, ROBOTCLAIMS

_NO_CLAIM: Final = ("holder", "instance", "component", "phase", "claim")
_PRESENCE: Final = {True: "yes", False: "no", None: "unknown"}
HIDDEN: Final = (
    "unknown: the node has a driver, and you may not list ResourceClaims, which show who holds its devices; "
    "ask for a ClusterRoleBinding of robotapp-cluster-viewer"
)


class Ledgers(NamedTuple):
    """Devices that RobotClaims and ResourceClaims hold, in one form. `hidden`: nodes on which other claims may hold devices."""

    claims: tuple[Claim, ...]
    hidden: frozenset[str] = frozenset()


async def show_devices(session: Session) -> None:
    """Prints every device of every node, with its holder."""
    nodes = (await session.client.list(NODES)).items
    telemetry = (await session.client.list(NODETELEMETRIES)).items
    ledgers = await read_ledgers(session.client, [meta(node)["name"] for node in nodes])
    rows = [_row_of(device) for devices in devices_of(nodes, telemetry, ledgers).values() for device in devices]
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
    if any(row["state"] == UNKNOWN for row in rows):
        print_line(HIDDEN, style="yellow")


async def read_ledgers(client: ApiClient, nodes: list[str]) -> Ledgers:
    """Returns who holds devices. On nodes with the driver ResourceClaims do, as far as the API server has them and the user may list them."""
    reserved = (await client.list(ROBOTCLAIMS, as_type=Claim)).items
    try:
        resource_claims = (await client.list(RESOURCECLAIMS, as_type=ResourceClaim)).items
    except NotFound:
        return Ledgers(tuple(reserved))
    except Forbidden:
        driver_nodes = await _list_driver_nodes(client)
        return Ledgers(tuple(reserved), find_hidden_nodes(nodes, claims_are_read=False, driver_nodes=driver_nodes))
    from_claims = (claim for resource_claim in resource_claims for claim in list_held(resource_claim))
    return Ledgers((*reserved, *from_claims))


async def _list_driver_nodes(client: ApiClient) -> list[str] | None:
    """Returns the nodes whose driver publishes devices, None where the user may not list them."""
    selector = f"spec.driver={DRIVER}"
    try:
        slices = (await client.list(RESOURCESLICES, field_selector=selector, as_type=ResourceSlice)).items
    except NotFound:
        return []
    except Forbidden:
        return None
    return [item.spec.node_name for item in slices]


def devices_of(nodes: list[Json], telemetry: list[Json], ledgers: Ledgers) -> dict[str, tuple[NodeDevice, ...]]:
    """Returns the devices by node, with their holders."""
    labels = {meta(node)["name"]: meta(node).get("labels") or {} for node in nodes}
    reports = {
        meta(report)["name"]: msgspec.convert(status(report).get("devices") or [], list[TelemetryDevice])
        for report in telemetry
    }
    return list_devices(labels, reports, ledgers.claims, hidden=ledgers.hidden)


def _tells(key: str, rows: list[dict[str, str]]) -> bool:
    """Is the column worth its width? Models and interfaces where there are any, presence where something is missing."""
    usual = {"model": "", "interface": "", "present": "yes"}
    return key not in usual or any(row[key] != usual[key] for row in rows)


def _cell(key: str, row: Mapping[str, str]) -> str:
    return row["state"] if key == "holder" and not row["holder"] else row[key]


def _row_of(device: NodeDevice) -> dict[str, str]:
    described = device.device
    row = {
        "node": device.node,
        "device": described.id,
        "present": _PRESENCE[device.is_present],
        "source": device.source,
        "state": device.state,
        "type": described.type,
        "model": described.model,
        "interface": described.interface,
        "names": ",".join(described.names),
        "path": device.path,
    }
    claim = device.claim
    if claim is None:
        return row | dict.fromkeys(_NO_CLAIM, "")
    values = (device.holder, claim.holder.instance, claim.holder.component, str(claim.status.phase), claim.name)
    return row | dict(zip(_NO_CLAIM, values, strict=True))
