"""Fleets written in YAML: nodes by tier, with zones, labels and devices. For simulated and for real nodes.

robots:
- {name: amr-07, devices: [{type: can, interface: can0}]}
- amr-08
edges: 2
clouds: 1
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import yaml

from robotapp_agent.devices.usb import letters
from robotapp_claims.rules.device import split_identity
from robotapp_claims.rules.identity import device_label
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.fake_host import CONTROLLER
from robotapp_testbed.machines.network import Topology
from robotapp_testbed.machines.nodes import Device, SimulatedNode
from robotapp_testbed.machines.topology import fleet

MOST_BYTES: Final = 1 << 20
MOST_NODES: Final = 10_000
"""Of a tier."""


class _Device(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    type: str
    interface: str = ""
    identity: str = ""
    model: str = ""
    path: str = ""


class _Node(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    zone: str = ""
    cpu: str = ""
    memory: str = ""
    labels: dict[str, str] = {}
    devices: list[_Device] = []


_Count = Annotated[int, msgspec.Meta(ge=0, le=MOST_NODES)]
_Tier = _Count | Annotated[list[str | _Node], msgspec.Meta(max_length=MOST_NODES)]


class _Fleet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    robots: _Tier = 0
    edges: _Tier = 0
    clouds: _Tier = 0


def is_file(text: str) -> bool:
    """Whether an argument names a fleet file rather than numbers or names of nodes."""
    return text.endswith((".yaml", ".yml"))


def read(path: Path) -> Topology:
    """TestbedError with file and field for what is no fleet."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise TestbedError(f"{path} is longer than {MOST_BYTES >> 20} MiB")
        return topology_of(yaml.safe_load(path.read_text()))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise TestbedError(f"{path} cannot be read: {error}") from error
    except ValueError as error:
        raise TestbedError(f"{path}: {error}") from error


def topology_of(document: object) -> Topology:
    """The nodes of a fleet file's content. Raises ValueError, which names the field. Pure."""
    try:
        wanted = msgspec.convert(document, _Fleet)
    except msgspec.ValidationError as error:
        raise ValueError(str(error).replace("$.", "")) from error
    tiers = [wanted.robots, wanted.edges, wanted.clouds]
    entries = [tier if isinstance(tier, int) else [_entry(node) for node in tier] for tier in tiers]
    made = list(fleet(*(tier if isinstance(tier, int) else [node.name for node in tier] for tier in entries)))
    described = {node.name: node for tier in entries if not isinstance(tier, int) for node in tier}
    if not made:
        raise ValueError("a fleet has at least one node: write robots, edges or clouds")
    if len(made) < sum(tier if isinstance(tier, int) else len(tier) for tier in entries):
        raise ValueError("two nodes have the same name")
    return Topology(_finished(node, described.get(node.name)) for node in made)


def _entry(node: str | _Node) -> _Node:
    return _Node(node) if isinstance(node, str) else node


def _finished(node: SimulatedNode, entry: _Node | None) -> SimulatedNode:
    if entry is None:
        return node
    given: Mapping[str, Any] = {"zone": entry.zone, "cpu": entry.cpu, "memory": entry.memory, "labels": entry.labels}
    changes = {name: value for name, value in given.items() if value}
    return replace(node, devices=_devices(entry.name, entry.devices), **changes)


def _devices(node: str, wanted: Sequence[_Device]) -> tuple[Device, ...]:
    made = tuple(
        Device(_id(node, each, port), each.type, each.model, each.interface, each.identity, each.path)
        for port, each in enumerate(wanted, start=1)
    )
    if len({each.id for each in made}) < len(made):
        raise ValueError(f"devices of {node}: two have the same interface or identity")
    return made


def _id(node: str, device: _Device, port: int) -> str:
    """As an agent names it: what is on USB by vendor, product and serial, or else its port; anything else by its interface.

    port: the one into which the doubles of a real node plug the device, by its place in the list.
    """
    if device.identity:
        parts = split_identity(device.identity)
        if parts is None:
            raise ValueError(f"devices of {node}: identity {device.identity!r} is not vid:pid or vid:pid:serial")
        name = parts.serial.lower() or f"{letters(CONTROLLER.rpartition('/')[2].removeprefix('0000:'))}-{port}"
        return device_label(f"{device.type}-{parts.vendor}-{parts.product}-{name}")
    if not device.interface:
        raise ValueError(
            f"devices of {node}: a {device.type} has an interface, such as can0, or an identity vid:pid or vid:pid:serial"
        )
    return device_label(f"{device.type}-{device.interface}")
