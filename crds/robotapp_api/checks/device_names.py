"""Finds devices that no node agent would ever publish or no driver hands over, and references to paths that are not fixed before a
container starts.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Final

from robotapp_api.checks.containers import list_containers
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.device import Device, Requirement
from robotapp_api.model.names import GPU
from robotapp_api.values.devices.variables import DEVICE_PREFIX, device_variable
from robotapp_api.values.devices.words import PLUGGING_ORDER, find_similar_type, list_types
from robotapp_api.values.naming import label_value

_BUILT_ABOVE_A_BUS: Final = frozenset({"lidar", "laser", "imu", "gps", "gnss", "motor"})
"""What a thing is for; agents publish what it is connected by, unless a rule of theirs names it."""
_INTERFACES: Final = frozenset({"can", "canbus", "can-bus", "socketcan"})
"""Types of network interfaces, which have no path."""
_LINK_FOLDERS: Final = ("/dev/serial/", "/dev/v4l/", "/dev/input/by-")
"""Folders of links whose names do not depend on the order of plugging in."""
_MOST_DEVICES_OF_A_CLAIM: Final = 32
"""What the allocation of one ResourceClaim can hold: AllocationResultsMaxSize of `resource.k8s.io/v1`."""
_REFERENCE: Final = re.compile(rf"(?<!\$)(?:\$\$)*\$\(({DEVICE_PREFIX}[A-Za-z0-9_]*)\)")
"""A reference that the kubelet would replace; `$$(NAME)` is the text `$(NAME)`."""


def device_problems(component: Component, at: str) -> Iterator[Problem]:
    """Yields devices that cannot be claimed or mounted as written. `at`: where the component stands."""
    exclusive = sum(device.count for device in component.devices if device.sharing == "Exclusive")
    if exclusive > _MOST_DEVICES_OF_A_CLAIM:
        yield invalid(
            f"{at}.devices",
            f"{exclusive} exclusive devices are more than one pod can have handed over, which are {_MOST_DEVICES_OF_A_CLAIM}; "
            "give some of them to another component",
        )
    for index, device in enumerate(component.devices):
        where = f"{at}.devices[{index}]"
        if device.count > 1 and device.type == GPU:
            yield invalid(
                f"{where}.count",
                f"GPUs are counted by their device plugin; write resources.limits with its resource, such as nvidia.com/gpu: {device.count}, and leave count out",
            )
        if device.type == "usb" and not (device.model or device.interface or device.usb_id):
            yield invalid(
                f"{where}.type",
                "usb alone is any USB device of the node; write its usbID or model (kubectl robotapp devices -o wide lists them), or the "
                "type that it has, such as video or serial",
            )
        if device.mount_as and device.type in _INTERFACES:
            yield invalid(
                f"{where}.mountAs",
                "a CAN bus is a network interface and has no path; leave mountAs out, and open it by its name",
            )
        if device.mount_as and device.type == GPU:
            yield invalid(f"{where}.mountAs", "its device plugin decides where a GPU is mounted; leave mountAs out")
        for other in component.devices:
            if device.mount_as and other.mount_as and device.mount_as.startswith(f"{other.mount_as}/"):
                yield invalid(
                    f"{where}.mountAs",
                    f"{device.mount_as} lies below {other.mount_as}, which is the device {other.name} and no folder; write another path",
                )
    yield from _reference_problems(component, at)


def _reference_problems(component: Component, at: str) -> Iterator[Problem]:
    """Yields references to paths of devices that nothing would replace: the container would get the reference as its text."""
    devices = {device_variable(device.name): index for index, device in enumerate(component.devices)}
    for field, text in _list_texts(component, at):
        for variable in dict.fromkeys(_REFERENCE.findall(text)):
            index = devices.get(variable)
            device = None if index is None else component.devices[index]
            if device is None:
                names = ", ".join(device.name for device in component.devices) or "none"
                yield invalid(
                    field,
                    f"$({variable}) is the path of no device of {component.name}, whose devices are {names}; write the variable of one of "
                    "them, with its mountAs",
                )
            elif not device.mount_as:
                yield invalid(
                    field, f"$({variable}) is not replaced: {_cure(device, variable, f'{at}.devices[{index}]')}"
                )


def _cure(device: Device, variable: str, where: str) -> str:
    if device.type in _INTERFACES:
        return (
            f"{device.name} is a network interface without a path; write its name, such as {device.interface or 'can0'}"
        )
    if device.count > 1:
        return (
            f"the paths of the {device.count} devices are fixed when the container starts; let the program or its shell read the variable, or "
            f"write a device of its own with mountAs for each"
        )
    return (
        f"the path is fixed when the container starts, unless it is written; write {where}.mountAs: /dev/{device.name}, or let the program or "
        f"its shell read the variable, such as args: [sh, -c, 'exec PROGRAM \"${variable}\"']"
    )


def _list_texts(component: Component, at: str) -> Iterator[tuple[str, str]]:
    """Yields the texts in which the kubelet replaces references, with their fields."""
    if component.run:
        yield from ((f"{at}.run.args", word) for word in component.run.args)
    if component.launch:
        yield from ((f"{at}.launch.arguments", value) for value in component.launch.arguments.values())
    for container, where in list_containers(component, at):
        for field in ("command", "args"):
            yield from ((f"{where}.{field}", str(text)) for text in container.get(field) or ())
        yield from ((f"{where}.env", str(variable.get("value") or "")) for variable in container.get("env") or ())


def device_name_notes(items: Iterable[Device | Requirement], at: str) -> Iterator[Note]:
    """Yields types, models and interfaces that no agent publishes by itself. `at`: where the list stands."""
    for index, item in enumerate(items):
        yield from _type_notes(item, f"{at}[{index}]")
        for name, value in (("model", item.model), ("interface", item.interface)):
            if port := PLUGGING_ORDER.fullmatch(value):
                yield Note(
                    f"{at}[{index}].{name}",
                    f"{port[1]} is a number in the order of plugging in, which agents do not publish for USB devices; write usbID: "
                    "VID:PID or VID:PID:SERIAL (kubectl robotapp devices -o wide lists them), or leave it out",
                )
            elif value.startswith(_LINK_FOLDERS):
                yield Note(
                    f"{at}[{index}].{name}",
                    f"{value} is a link that udev makes, and agents publish no links; write usbID: VID:PID or VID:PID:SERIAL (kubectl "
                    "robotapp devices -o wide lists them)",
                )
            elif value and not label_value(value):
                yield Note(
                    f"{at}[{index}].{name}",
                    f'no device that a node agent finds has "{value}", because it writes them as label values; leave it out',
                )


def handover_notes(component: Component, at: str) -> Iterator[Note]:
    """Yields devices that no driver hands over as they are written. `at`: where the component stands.

    A bus of one's own keeps the component's other devices from being handed over, too: it has one ledger.
    """
    for index, device in enumerate(component.devices):
        where = f"{at}.devices[{index}]"
        if device.type == GPU:
            continue
        if device.sharing != "Exclusive":
            yield Note(
                f"{where}.sharing",
                f"{device.sharing}: no driver hands a shared device over; leave sharing out and publish its data from this component, or "
                "mount the device file by hostPath, which takes the right robotapps/hostpath",
            )
        elif "can" in list_types(device.type) and not component.template.spec.host_network:
            yield Note(
                f"{where}.type",
                "a CAN bus is a network interface of the node, which a pod with a network of its own does not have, and no driver hands "
                "devices of this component over; write template: {spec: {hostNetwork: true}}, which takes the right robotapps/hostnetwork",
            )


def _type_notes(item: Device | Requirement, at: str) -> Iterator[Note]:
    kind = item.type.lower()
    if kind in _BUILT_ABOVE_A_BUS:
        yield Note(
            f"{at}.type",
            f"agents publish what a device is connected by, and no {item.type} unless a rule of theirs names it so; write serial, "
            "usb or can with its usbID or model, or add the rule",
        )
    elif near := find_similar_type(item.type):
        yield Note(
            f"{at}.type", f'agents publish no {item.type} unless a rule of theirs names it so; did you mean "{near}"?'
        )
    elif kind == GPU and isinstance(item, Device):
        yield Note(
            f"{at}.type",
            "no claim is made for a gpu, because its device plugin hands it out; write its resource, such as resources: {limits: "
            "{nvidia.com/gpu: 1}}, and requires: [{type: gpu}] where the node must merely have one",
        )
