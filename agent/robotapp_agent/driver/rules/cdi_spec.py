"""The CDI spec of a prepared claim: what the container runtime adds to the containers that use its devices."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules.allocation import NETWORK_TYPES, group_by_request
from robotapp_agent.driver.rules.ledger import PreparedClaim, PreparedDevice
from robotapp_claims.rules.device_attributes import DRIVER

KIND: Final = f"{DRIVER}/device"
VERSION: Final = "0.6.0"
VERSION_WITH_GROUPS: Final = "0.7.0"
"""`additionalGids` came with this version."""
OPEN_TO_ALL: Final = 0o666
"""Mode of the device file in the container: that the container has it is the permission, whatever user its programs run as."""
_SOUND_CARD: Final = re.compile(r"/dev/snd/controlC([0-9]+)")

Json = dict[str, Any]


class DeviceFile(msgspec.Struct, frozen=True):
    """A device file of the host, symbolic links resolved."""

    path: str
    terminal: bool = False
    """A pseudo-terminal: another node with its number opens nothing, so the file itself is mounted."""
    gid: int = 0
    number: int = 0
    """Major and minor number; 0 for /dev/zero and its like, which are no hardware and in every container."""


def files_of(device: Device, sound_files: Iterable[str]) -> tuple[str, ...]:
    """Paths of the device's files, the one that programs are told of first. Network interfaces have none.

    sound_files: names below /dev/snd; a card is opened by its control file and plays by others.
    """
    if device.type in NETWORK_TYPES:
        return ()
    card = _SOUND_CARD.fullmatch(device.path)
    if card is None:
        return (device.path,)
    of_card = re.compile(rf"(pcm|hw|midi)C{card[1]}(D[0-9]+[pc]?)?")
    return (device.path, *(f"/dev/snd/{name}" for name in sorted(sound_files) if of_card.fullmatch(name)))


def cdi_name(claim: PreparedClaim, device: PreparedDevice) -> str:
    """Name of the device within the spec: unique on the node."""
    return f"{claim.uid}-{device.request.replace('/', '.')}-{device.device}"


def cdi_id(claim: PreparedClaim, device: PreparedDevice) -> str:
    """The fully qualified name by which the kubelet asks the runtime for the device."""
    return f"{KIND}={cdi_name(claim, device)}"


def spec_of(
    claim: PreparedClaim, devices: Mapping[str, Device], files: Mapping[str, Sequence[DeviceFile]]
) -> Json | None:
    """The spec, None while one of the claim's devices is not there.

    devices: by id. files: of each id, in the order of `files_of`.
    """
    entries = []
    with_groups = False
    for group in group_by_request(claim.devices).values():
        paths = [_path_inside(device, devices.get(device.device)) for device in group]
        if not all(paths):
            return None
        variable = f"{group[0].variable}={','.join(paths)}"
        for device, path in zip(group, paths, strict=True):
            of_device = files.get(device.device, ())
            if devices[device.device].type not in NETWORK_TYPES and not of_device:
                return None
            edits = _container_edits(of_device, path)
            with_groups = with_groups or "additionalGids" in edits
            entries.append({"name": cdi_name(claim, device), "containerEdits": {"env": [variable], **edits}})
    version = VERSION_WITH_GROUPS if with_groups else VERSION
    return {"cdiVersion": version, "kind": KIND, "devices": entries}


def _path_inside(prepared_device: PreparedDevice, device: Device | None) -> str:
    """Returns what the variable holds: the path in the container, or the name of a network interface."""
    if device is None or not device.present:
        return ""
    return device.interface if device.type in NETWORK_TYPES else prepared_device.mount_as or device.path


def _container_edits(files: Sequence[DeviceFile], path: str) -> Json:
    nodes, mounts, groups = [], [], []
    for position, file in enumerate(files):
        inside = path if position == 0 else file.path
        if file.terminal:
            options = ["bind", "rw", "nosuid", "noexec"]
            mounts.append({"hostPath": file.path, "containerPath": inside, "type": "bind", "options": options})
            groups += [file.gid] if file.gid else []
        else:
            nodes.append({"path": inside, "hostPath": file.path, "permissions": "rw", "fileMode": OPEN_TO_ALL})
    edits = {"deviceNodes": nodes, "mounts": mounts, "additionalGids": groups}
    return {key: value for key, value in edits.items() if value}
