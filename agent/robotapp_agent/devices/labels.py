"""Device → node labels `hardware.robotics.io/<type>[-<interface>]: <model|true>`: the one rule of feature file and labeller."""

import re
from collections.abc import Iterable, Iterator
from typing import Final

from robotapp_agent.devices.device import Device
from robotapp_api.model.names import FROM_TELEMETRY, HARDWARE_PREFIX, HARDWARE_SOURCE

MOST_LABELS: Final = 256
"""More would crowd the Node object; ids and extra names are left out first, types never."""
NO_MODEL: Final = "true"
_NAME: Final = re.compile(r"[A-Za-z0-9]([-A-Za-z0-9_.]{0,61}[A-Za-z0-9])?")
"""What the API server takes after the slash of a label's key."""


def labels_of(devices: Iterable[Device]) -> dict[str, str]:
    """Labels of the devices that are plugged in; empty without any.

    A key that several devices give has their model when they are of one, else `true`: what one label can hold of two models
    is that there are some. `hardware.robotics.io/source` keeps the scheduler from counting these labels as devices: one
    device has several of them, but one id.
    """
    models: dict[str, set[str]] = {}
    for device in devices:
        if device.present:
            for name in filter(_NAME.fullmatch, names_of(device)):
                models.setdefault(name, set()).add(device.model or NO_MODEL)
    if not models:
        return {}
    by_words = sorted(models, key=lambda name: (name.count("-"), name))
    labels = {HARDWARE_PREFIX + name: _one(models[name]) for name in sorted(by_words[: MOST_LABELS - 1])}
    return labels | {HARDWARE_SOURCE: FROM_TELEMETRY}


def names_of(device: Device) -> Iterator[str]:
    """Everything the device is found by: type, type-interface, id, and its further names, each with the word it begins with."""
    yield device.type
    if device.interface:
        yield f"{device.type}-{device.interface}"
    yield device.id
    for name in device.names:
        yield name
        yield name.partition("-")[0]


def _one(models: set[str]) -> str:
    return next(iter(models)) if len(models) == 1 else NO_MODEL
