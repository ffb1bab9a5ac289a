"""The variables in which a container finds its devices."""

from typing import Final

DEVICE_PREFIX: Final = "ROBOTAPP_DEVICE_"


def device_variable(name: str) -> str:
    """Returns the variable with the path of the device that a component calls `name`.

    A name is a DNS label, so two names of a component never give one variable.
    """
    return f"{DEVICE_PREFIX}{name.upper().replace('-', '_')}"
