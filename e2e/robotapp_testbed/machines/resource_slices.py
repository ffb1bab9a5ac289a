"""A stand-in for the DRA drivers: publishes the devices of simulated nodes as ResourceSlices, in the driver's own form.

A pod that uses a claim on one of them runs on its simulated node like any other; no container gets anything.
"""

from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules import slices as rules
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.nodes import SimulatedNode
from robotapp_testbed.machines.telemetry import first_of_usb, node_uids

_API: Final = "resource.k8s.io/v1"
SLICES: Final = f"/apis/{_API}/resourceslices"
CLASSES: Final = f"/apis/{_API}/deviceclasses"
NOTHING: Final[Mapping[str, Collection[str]]] = {}


def publish(
    cp: ControlPlane, nodes: Iterable[SimulatedNode], *, unplugged: Mapping[str, Collection[str]] = NOTHING
) -> None:
    """Writes the slices of these nodes, and the DeviceClass that the chart would bring. May be repeated after a change.

    unplugged: ids of lost devices by node, which get the driver's taint.
    """
    _create_class(cp)
    uids = node_uids(cp)
    cp.api.each(lambda node: _publish_one(cp, node, uids[node.name], unplugged.get(node.name, ())), nodes)


def devices_of(node: SimulatedNode, *, unplugged: Collection[str] = ()) -> list[Device]:
    """The node's devices as an agent finds them."""
    usb = first_of_usb(node.devices)
    return [
        Device(
            id=device.id,
            type=device.type,
            model=device.model,
            interface=device.interface,
            identity=device.identity,
            path=device.path,
            present=device.id not in unplugged,
            names=("usb",) if device in usb and device.type != "usb" else (),
        )
        for device in node.devices
    ]


def _publish_one(cp: ControlPlane, node: SimulatedNode, uid: str, unplugged: Collection[str]) -> None:
    stored = _read(cp, node.name)
    entries = rules.slice_devices(devices_of(node, unplugged=unplugged), withheld=(), with_taints=True)
    for body in rules.slices_of(node.name, entries, node_uid=uid, generation=rules.next_generation(stored.values())):
        name = body["metadata"]["name"]
        document = {"apiVersion": _API, "kind": "ResourceSlice", **body}
        if name not in stored:
            cp.api.create(SLICES, document)
            continue
        version = stored.pop(name)["metadata"]["resourceVersion"]
        document["metadata"]["resourceVersion"] = version
        cp.api.request("PUT", f"{SLICES}/{name}", document)
    for name in stored:
        cp.api.delete(f"{SLICES}/{name}")


def _read(cp: ControlPlane, node: str) -> dict[str, Any]:
    items = cp.api.get(f"{SLICES}?fieldSelector=spec.nodeName={node},spec.driver={DRIVER}")["items"]
    return {item["metadata"]["name"]: item for item in items}


def _create_class(cp: ControlPlane) -> None:
    expression = f'device.driver == "{DRIVER}"'
    body = {
        "apiVersion": _API,
        "kind": "DeviceClass",
        "metadata": {"name": DRIVER},
        "spec": {"selectors": [{"cel": {"expression": expression}}]},
    }
    try:
        cp.api.create(CLASSES, body)
    except ApiStatusError as error:
        if error.status != 409:
            raise
