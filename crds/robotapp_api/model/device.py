"""Hardware a component needs: devices it holds alone or shared, and capabilities its node must have."""

from typing import Annotated, Literal

from pydantic import StringConstraints

from robotapp_api.model.base import Model
from robotapp_api.model.scalars import DnsLabel, ShortText, Token

OnLoss = Literal["Keep", "Restart", "Reschedule"]


class Device(Model):
    """A device of the node, matched against what the node's agent reports and claimed for the component."""

    name: DnsLabel
    """Name of the requirement within the component; the path arrives in ROBOTAPP_DEVICE_<NAME>."""
    type: Token
    """Type of device: usb, can, serial, gpio or another type nodes report."""
    model: ShortText = ""
    """Model the device must have; empty means any."""
    interface: ShortText = ""
    """Interface the device must have, such as can0; empty means any."""
    match: (
        Annotated[str, StringConstraints(max_length=128, pattern=r"^[0-9a-fA-F]{4}:[0-9a-fA-F]{4}(:.+)?$")] | None
    ) = None
    """USB identity vid:pid or vid:pid:serial, such as 8086:0b3a."""
    exclusive: bool = True
    """Nobody else may hold the device."""
    on_loss: OnLoss = "Keep"
    """What happens when the device vanishes: Keep the pod, Restart it in place, or Reschedule it to another node."""


class Requirement(Model):
    """A capability of the node that is not claimed, such as a GPU model."""

    type: Token
    """Capability: the node label hardware.robotics.io/<type> must exist."""
    model: ShortText = ""
    """Value the capability's label must have; empty means any."""
