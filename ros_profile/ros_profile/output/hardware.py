"""Hardware as fields of a component: `devices` and `requires`. Pure, standard library only: rigel_bridge has the rule from here."""

from collections.abc import Iterable, Mapping
from typing import Final

EXCLUSIVE_TYPES: Final = frozenset({"usb", "can", "serial", "gpio"})
"""Hardware that bare pods have for themselves, one at a time."""
CLAIMED_TYPES: Final = EXCLUSIVE_TYPES | {"video", "input"}
"""Hardware that a component claims: one program opens it, and only the claim brings it into the container. Everything else,
such as a GPU, is a property of the node.
"""

Entry = dict[str, str]
"""`type`, and what else is stated of the hardware, in the API's words."""


def devices_and_requires(hardware: Iterable[Mapping[str, str]]) -> dict[str, list[Entry]]:
    """The two fields, without empty ones. Each device has a name: `can`, and from the second one `can-2`.

    A property of the node is not claimed, so asking twice for it means nothing: it stands once.
    """
    devices: list[Entry] = []
    requires: list[Entry] = []
    for one in hardware:
        kind = one["type"]
        if kind in CLAIMED_TYPES:
            same = sum(device["type"] == kind for device in devices)
            devices.append({"name": f"{kind}-{same + 1}" if same else kind, **one})
        elif one not in requires:
            requires.append(dict(one))
    return {field: found for field, found in (("devices", devices), ("requires", requires)) if found}
