"""Which devices a node has: those its agent reports, else those its labels name. One rule for the scheduler and the CLI."""

from collections.abc import Mapping
from typing import NamedTuple

from robotapp_api.model.names import FROM_TELEMETRY, HARDWARE_PREFIX, HARDWARE_SOURCE


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
