"""The node's devices as ResourceSlices: one pool per node, at most 64 devices in a slice."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final

from robotapp_agent.devices.device import Device
from robotapp_api.model.names import GPU
from robotapp_api.values.naming import short_hash
from robotapp_claims.rules.device_attributes import DRIVER, attributes_of

MOST_DEVICES_OF_SLICE: Final = 64
"""The API's bound where devices have taints."""
LOST: Final = f"{DRIVER}/lost"
"""Taint of a device that was unplugged: a pod that has it may keep it, no claim gets it."""
_LONGEST_NODE_PART: Final = 200

Json = dict[str, Any]


def slice_devices(devices: Iterable[Device], *, withheld: Collection[str], with_taints: bool) -> list[Json]:
    """Entries of the slices, sorted by id.

    GPUs are left to their own drivers. withheld: ids that RobotClaims hold. with_taints: whether the API server keeps taints;
    where it drops them, a lost device would look free and is left out.
    """
    entries = []
    for device in sorted(devices, key=lambda device: device.id):
        if device.type == GPU or device.id in withheld or not (device.present or with_taints):
            continue
        entry: Json = {"name": device.id, "attributes": attributes_of(device, path=device.path)}
        if not device.present:
            entry["taints"] = [{"key": LOST, "effect": "NoSchedule"}]
        entries.append(entry)
    return entries


def slices_of(node: str, entries: Sequence[Json], *, node_uid: str, generation: int) -> list[Json]:
    """The slices of the node's pool. A node without devices has an empty one, which shows that the driver runs.

    node_uid: of the Node object, which owns them; "" where the token names none.
    """
    chunks = [
        entries[start : start + MOST_DEVICES_OF_SLICE]
        for start in range(0, max(len(entries), 1), MOST_DEVICES_OF_SLICE)
    ]
    pool = {"name": node, "generation": generation, "resourceSliceCount": len(chunks)}
    owner = {"apiVersion": "v1", "kind": "Node", "name": node, "uid": node_uid, "controller": True}
    return [
        {
            "metadata": {"name": slice_name(node, number), **({"ownerReferences": [owner]} if node_uid else {})},
            "spec": {"driver": DRIVER, "nodeName": node, "pool": {**pool}, "devices": list(chunk)},
        }
        for number, chunk in enumerate(chunks)
    ]


def slice_name(node: str, number: int) -> str:
    """The name follows from the node, so that no slices of other nodes need to be listed."""
    part = node if len(node) <= _LONGEST_NODE_PART else f"{node[:_LONGEST_NODE_PART]}-{short_hash(node, 10)}"
    return f"{part}-{DRIVER}-{number}"


def list_stored_entries(slices: Iterable[Mapping[str, Any]]) -> list[Json]:
    """Entries as the API server has them, without what it adds by itself."""
    entries = []
    for stored_slice in slices:
        for device in stored_slice["spec"].get("devices") or ():
            taints = [{"key": t["key"], "effect": t["effect"]} for t in device.get("taints") or ()]
            fields = {key: device[key] for key in ("name", "attributes") if key in device}
            entries.append({**fields, "taints": taints} if taints else fields)
    return entries


def next_generation(slices: Iterable[Mapping[str, Any]]) -> int:
    """A generation above all that are there."""
    return 1 + max((stored_slice["spec"]["pool"].get("generation", 0) for stored_slice in slices), default=0)


def is_published(slices: Sequence[Mapping[str, Any]], pool_slices: Sequence[Mapping[str, Any]]) -> bool:
    """Returns whether the API server has the pool's slices as they should be: devices, owner, one generation, complete."""
    if len(slices) != len(pool_slices):
        return False
    generations = {stored_slice["spec"]["pool"].get("generation", 0) for stored_slice in slices}
    counts = {stored_slice["spec"]["pool"].get("resourceSliceCount") for stored_slice in slices}
    are_equal = all(
        _owner_uids(stored_slice) == _owner_uids(pool_slice)
        and list_stored_entries([stored_slice]) == pool_slice["spec"]["devices"]
        for stored_slice, pool_slice in zip(slices, pool_slices, strict=True)
    )
    return are_equal and len(generations) == 1 and counts == {len(pool_slices)}


def were_taints_dropped(pool_slice: Mapping[str, Any], answer: Mapping[str, Any]) -> bool:
    """Returns whether the API server left out taints of a slice that was written: it does not serve them."""
    taints = [device.get("taints") for device in pool_slice["spec"]["devices"]]
    stored_taints = [device.get("taints") for device in answer["spec"].get("devices") or ()]
    return any(taints) and not any(stored_taints)


def _owner_uids(stored_slice: Mapping[str, Any]) -> list[str]:
    return [owner["uid"] for owner in stored_slice["metadata"].get("ownerReferences") or ()]
