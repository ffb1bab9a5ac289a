"""Devices of a service: which paths become claimed devices, which stay files of the node, and GPUs."""

import posixpath
import re
from typing import Final, NamedTuple

from robotapp_api.model.names import GPU
from robotapp_api.model.patterns import is_device_path
from robotapp_api.values.devices.variables import device_variable
from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.services.draft import Draft, make_label, make_unique, report_fields
from robotapp_cli.lint.marks import PATH_MARK


class Kind(NamedTuple):
    """A kind of device file. `interface` is true where the file has the kernel's name of the device."""

    pattern: re.Pattern[str]
    type: str
    interface: bool = False


_KINDS: Final = (
    Kind(re.compile(r"/dev/(ttyTHS|ttyAMA|ttyS|ttymxc|ttyO)\d+"), "serial", interface=True),
    Kind(re.compile(r"/dev/(ttyUSB|ttyACM)\d*|/dev/serial/by-(id|path)/.+"), "serial"),
    Kind(re.compile(r"/dev/video\d+|/dev/v4l/by-(id|path)/.+"), "video"),
    Kind(re.compile(r"/dev/gpiochip\d+"), "gpio", interface=True),
    Kind(re.compile(r"/dev/i2c-\d+"), "i2c", interface=True),
    Kind(re.compile(r"/dev/spidev\d+\.\d+"), "spi", interface=True),
    Kind(re.compile(r"/dev/input/(js|event)\d+"), "input"),
)
_NVIDIA: Final = "nvidia.com/gpu"
_MOST_DEVICES: Final = 16


def take_devices(draft: Draft, part: Part) -> None:
    """Takes device files: claimed where the path shows the type, else mounted from the node."""
    for item in part.as_items():
        if item.fields is not None:
            source, target = item.get("source"), item.get("target") or item.get("source")
            report_fields(
                draft,
                item,
                frozenset({"source", "target"}),
                {"permissions": "a container that may open the file may read and write it"},
            )
            if source is None or target is None:
                raise item.fail("a device needs a source; write source: /dev/ttyUSB0")
            _take_device(draft, item, source.as_text(), target.as_text())
            continue
        words = item.as_text().split(":")
        inside = words[1] if len(words) > 1 and words[1].startswith("/") else words[0]
        _take_device(draft, item, words[0], inside)


def _take_device(draft: Draft, item: Part, outside: str, inside: str) -> None:
    report = draft.report
    if not outside.startswith("/") and item.unset:
        volume = {"name": "device", "hostPath": {"path": f"/{PATH_MARK}"}}
        draft.mount(volume, {"mountPath": f"/{PATH_MARK}"}, item)
        text = (
            f"{item.unset[0]} has no value here; give --env {item.unset[0]}=/dev/…, or write devices of the component"
        )
        report.mark(item, text)
        return
    if not outside.startswith("/"):
        if "=" in outside or not outside:
            report.omit(item, "no path of a device; write devices of the component (docs/how-to/use-a-device.md)")
            return
        raise item.fail(f"{outside[:60]!r} is no path of a device; write for example /dev/ttyUSB0")
    devices = draft.fields.get("devices", [])
    kind = next((kind for kind in _KINDS if kind.pattern.fullmatch(outside)), None)
    kind = kind or next((kind._replace(interface=False) for kind in _KINDS if kind.pattern.fullmatch(inside)), None)
    if kind is None or len(devices) >= _MOST_DEVICES:
        volume = {"name": make_label(f"device-{outside}"), "hostPath": {"path": posixpath.normpath(outside)}}
        draft.mount(volume, {"mountPath": inside}, item)
        text = f"{outside} of the node, which takes the right robotapps/hostpath; opening it takes privileged: true"
        report.change(item, text)
        return
    name = make_label(posixpath.basename(outside))[:40].strip("-")
    device = {"name": make_unique(name, [other["name"] for other in devices]), "type": kind.type}
    if kind.interface:
        device["interface"] = posixpath.basename(outside)
    if is_device_path(inside) and inside not in [other.get("mountAs") for other in devices]:
        device["mountAs"] = inside
    draft.fields.setdefault("devices", []).append(device)
    wish = f"the {kind.type} device {device['interface']}" if kind.interface else f"any free {kind.type} device"
    place = device.get("mountAs") or f"the path in {device_variable(device['name'])}"
    text = f"devices: {wish}, claimed, at {place} where the node hands devices over; add usbID or model to choose one"
    report.change(item, text)


def take_gpus(draft: Draft, part: Part) -> None:
    """Takes the short form of a GPU reservation: all, a number, or a list."""
    if part.items is not None:
        for item in part.items:
            take_device_reservation(draft, item)
        return
    text = part.as_text()
    count = int(text) if text.isascii() and text.isdigit() else 1
    draft.limit("limits", _NVIDIA, count)
    _report_gpu(draft, part, count, is_exact=text.isdigit())


def take_device_reservation(draft: Draft, part: Part) -> None:
    """Takes one entry of deploy.resources.reservations.devices."""
    capabilities, count = part.get("capabilities"), part.get("count")
    names = {item.as_text() for item in capabilities.as_items()} if capabilities else set()
    driver = part.get("driver")
    name = driver.as_text() if driver else "nvidia"
    reasons = {
        "device_ids": "the device plugin chooses which GPU",
        "options": "the device plugin has its own settings",
        "driver": "there is no resource of this name; ask the device plugin's page",
        "capabilities": "only gpu is a resource of nodes",
        "count": "only GPUs are counted",
    }
    if name not in {"nvidia", "amd"} or not names & {"gpu", "nvidia"}:
        report_fields(draft, part, frozenset(), reasons)
        return
    ids = part.get("device_ids")
    text = count.as_text() if count else str(len(ids.as_items())) if ids else "all"
    number = int(text) if text.isascii() and text.isdigit() else 1
    draft.limit("limits", f"{name}.com/gpu", number)
    _report_gpu(draft, count or part, number, is_exact=text.isdigit())
    read_fields = frozenset({"count", "driver", "capabilities"})
    for key in ("driver", "capabilities"):
        if inner := part.get(key):
            draft.report.take(inner, f"resources.limits: {name}.com/gpu")
    report_fields(draft, part, read_fields, reasons)


def take_runtime(draft: Draft, part: Part) -> None:
    """Takes the container runtime of NVIDIA as a GPU; others are named."""
    if part.as_text() != "nvidia":
        draft.report.omit(part, "write template.spec.runtimeClassName, if the cluster has a RuntimeClass for it")
        return
    draft.fields.setdefault("resources", {}).setdefault("limits", {}).setdefault(_NVIDIA, 1)
    draft.report.change(
        part, f"resources.limits: {_NVIDIA}, for which nodes need NVIDIA's device plugin; or runtimeClassName"
    )


def _report_gpu(draft: Draft, part: Part, count: int, *, is_exact: bool) -> None:
    note = "" if is_exact else "; a pod asks for a number of GPUs, so write more if it needs them"
    verdict = draft.report.take if is_exact else draft.report.change
    verdict(part, f"resources.limits: {count} {GPU}, handed out by the device plugin{note}")
