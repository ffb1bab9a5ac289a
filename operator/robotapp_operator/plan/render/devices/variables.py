"""The variables of devices whose path is fixed before the container starts."""

from robotapp_api.model.app.component import Component
from robotapp_api.values.devices.variables import device_variable


def device_variables(component: Component) -> list[dict[str, str]]:
    """Returns the variables of devices with `mountAs`, so that the kubelet can replace references to them.

    The driver sets the others: it alone has their paths, and the kubelet replaces no reference to a variable that a driver sets.
    """
    return [
        {"name": device_variable(device.name), "value": device.mount_as}
        for device in component.devices
        if device.mount_as
    ]
