"""Hardware a component needs: devices it holds alone or shared, and capabilities its node must have."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, WithJsonSchema

from robotapp_api.model.base import Model
from robotapp_api.model.markers import Rule
from robotapp_api.model.patterns import DEVICE_PATH_PATTERN, PATHS_OF_CONTAINERS
from robotapp_api.model.scalars import DnsLabel, ShortText, Token

OnLoss = Literal["Keep", "Restart", "Reschedule"]
UsbId = Annotated[
    str, StringConstraints(max_length=128, pattern=r"^(0[xX])?[0-9a-fA-F]{4}:(0[xX])?[0-9a-fA-F]{4}(:.+)?$")
]
DevicePath = Annotated[
    str,
    StringConstraints(max_length=96, pattern=DEVICE_PATH_PATTERN),
    WithJsonSchema({"type": "string", "maxLength": 96}),
    Rule(
        rule=f"self.matches('{DEVICE_PATH_PATTERN}')",
        message="write a path below /dev, such as /dev/lidar, of letters, digits and . _ : @ + -",
    ),
    Rule(
        rule=f"!self.matches('{PATHS_OF_CONTAINERS}')",
        message="every container has this path already; write another one, such as /dev/lidar",
    ),
]
"""Where a device appears in containers. A rule beside the pattern, because the API server shows a rule's message."""
Sharing = Literal["Exclusive", "Namespace", "Cluster"]


class Device(Model):
    """A device of the node, matched against what the node's agent reports and claimed for the component."""

    RULES = (
        Rule(
            rule="!has(self.mountAs) || self.count == 1",
            message="one path takes one device; write count: 1, or leave mountAs out and read the variable of the device",
            expression="'device %s: one path takes one device; write count: 1, or leave mountAs out and read its variable'.format([self.name])",
            path=".mountAs",
        ),
    )

    name: DnsLabel
    """Name of the device within the component. ROBOTAPP_DEVICE_<NAME> carries its path where the node hands devices over, the name in
    capitals and with _ for -; with a count it carries all paths, separated by commas."""
    type: Token
    """Type of device: video, serial, can, gpio, usb or another type nodes report. Usual words stand for these, such as camera for video;
    usb needs a usbID, model or interface."""
    model: ShortText = ""
    """Model the device must have, as the maker or the agent writes it; empty means any."""
    interface: ShortText = ""
    """Interface the device must have, such as can0; empty means any."""
    usb_id: Annotated[UsbId | None, Field(alias="usbID")] = None
    """USB identity vid:pid or vid:pid:serial, such as 8086:0b3a."""
    mount_as: DevicePath | None = None
    """Path below /dev under which the containers find the device, such as /dev/lidar, where the node hands devices over. It is fixed
    before the start, so $(ROBOTAPP_DEVICE_<NAME>) is replaced in command, args and env. Absent means the path that the device has on
    its node."""
    count: Annotated[int, Field(ge=1, le=16)] = 1
    """How many different devices of this kind the component needs, all on one node. Not for GPUs, which a device plugin counts."""
    sharing: Sharing = "Exclusive"
    """Who may use the device at the same time: nobody else (Exclusive), pods of this namespace (Namespace) or everybody
    (Cluster). A device that is not exclusive must be there and is not held, but nobody gets it alone while it is in use;
    Namespace acts like Cluster so far."""
    on_loss: OnLoss = "Keep"
    """What happens to the pod when an exclusive device vanishes: Keep it; Restart it when the device is back; or Reschedule it as
    soon as another node has a free one, within placement.reschedule.{cooldown, maxPerDay}. A loss of less than 10 s moves
    and restarts nothing."""


class Requirement(Model):
    """A capability of the node that is not claimed, such as a GPU model."""

    type: Token
    """Capability: the node label hardware.robotics.io/<type>, or hardware.robotics.io/<type>-<interface>, must exist."""
    model: ShortText = ""
    """Value the capability's label must have; empty means any."""
    interface: ShortText = ""
    """Interface of the capability, such as usb-cam of a sensor; empty means any."""
