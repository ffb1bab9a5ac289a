"""From a snapshot to candidates: which entries of sysfs are a device of which type, and which belong to one device."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Final

import msgspec

from robotapp_agent.devices.tree import USB_DEVICE, Entry, Snapshot
from robotapp_agent.devices.usb import Usb, UsbTree, function_number, letters
from robotapp_api.values.naming import label_value

_NO_CAMERAS: Final = re.compile(
    r".*(codec|-isp|pispbe|rpivid|hevc-dec|hantro|rkvdec|vepu|vdpu|vdec|venc|wave5|imx8-jpeg|scaler|rotate).*"
)
"""Names that drivers of encoders and scalers give their video nodes; udev's properties tell better, where they are there."""
_JOYSTICK_BITS: Final = ((1 << 0x20) - 1) << 0x120
"""Keys BTN_JOYSTICK … and BTN_GAMEPAD … of the kernel's input-event-codes."""
_WORDS: Final = re.compile(r"[0-9a-f]{1,16}( [0-9a-f]{1,16}){0,31}")
_PCI: Final = re.compile(r"[0-9a-f]{4}:[0-9a-f]{2}:[0-9a-f]{2}\.[0-7]")
_PCI_ID: Final = re.compile(r"0x([0-9a-fA-F]{4})")
_GPU_MODELS: Final = {"10de": "nvidia", "1002": "amd", "8086": "intel", "1af4": "virtio"}
_GPU_DRIVERS: Final = {
    "nvgpu": "nvidia", "tegra": "nvidia", "tegra-drm": "nvidia", "v3d": "broadcom", "vc4": "broadcom", "panfrost": "arm",
    "panthor": "arm", "lima": "arm", "msm": "qualcomm", "msm_dpu": "qualcomm", "etnaviv": "vivante", "powervr": "imagination",
}  # fmt: skip
_BUS_NUMBER: Final = re.compile(r"[0-9]{1,3}")


class Candidate(msgspec.Struct, frozen=True, kw_only=True):
    """A device before the admin's rules and before its id is written."""

    type: str
    stable_name: str
    model: str = ""
    interface: str = ""
    identity: str = ""
    path: str = ""
    entry: Entry
    """Of several nodes the one to open."""
    usb: str = ""
    """Path of the USB device it is a function of."""
    names: tuple[str, ...] = ()


def candidates(snapshot: Snapshot, usb: UsbTree, *, extra: frozenset[str] = frozenset()) -> list[Candidate]:
    """All devices of the snapshot, except USB devices as a whole (`usb_devices`).

    extra: subsystems that only rules of the admin know; their entries are candidates without a type.
    """
    by_subsystem = _by_subsystem(snapshot)
    gpus = by_subsystem.get("drm", ())
    by_subsystem["i2c-dev"] = [bus for bus in by_subsystem.get("i2c-dev", ()) if not _on_card(bus, gpus)]
    found = [each for subsystem, kind in _KINDS.items() for each in kind(by_subsystem.get(subsystem, ()), usb)]
    found += _gpus(gpus, snapshot)
    for subsystem in sorted(extra - _KINDS.keys() - {"drm", "usb"}):
        for entry in by_subsystem.get(subsystem, ()):
            found.append(_candidate("", entry, usb, path=f"/dev/{entry.name}", name=entry.name, model=entry.driver))
    return found


def usb_devices(snapshot: Snapshot, usb: UsbTree, *, told: Collection[str]) -> Iterator[Candidate]:
    """USB devices of which no function is a device of another type: lidars, radios, sticks. Hubs are none.

    told: paths of those of which one is.
    """
    for entry in _by_subsystem(snapshot).get("usb", ()):
        device = usb.of(entry.path) if USB_DEVICE.fullmatch(entry.name) else None
        if device is not None and not device.hub and device.path not in told:
            yield _usb_device(entry, device, usb)


def _by_subsystem(snapshot: Snapshot) -> dict[str, list[Entry]]:
    found: dict[str, list[Entry]] = {}
    for entry in sorted(snapshot.entries, key=_natural):
        found.setdefault(entry.subsystem, []).append(entry)
    return found


def _natural(entry: Entry) -> tuple[str, int, str, str]:
    return (entry.subsystem, len(entry.name), entry.name, entry.path)


def _candidate(
    kind: str, entry: Entry, usb: UsbTree, *, path: str, name: str, model: str = "", function: bool = True
) -> Candidate:
    """A function of a USB device is named after that device, anything else is called `name`."""
    device = usb.of(entry.path)
    if device is None:
        return Candidate(type=kind, stable_name=name, interface=name, model=label_value(model), path=path, entry=entry)
    parts = (usb.stable_name(device), function_number(entry) if function else "")
    return Candidate(
        type=kind,
        stable_name="-".join(part for part in parts if part),
        model=label_value(device.model or model),
        identity=device.identity,
        path=path,
        entry=entry,
        usb=device.path,
    )


def _video(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    """A camera has several nodes: of those of one device, the first with index 0 is the one that gives pictures."""
    groups: dict[str, list[Entry]] = {}
    for entry in entries:
        device = usb.of(entry.path)
        groups.setdefault(device.path if device else _camera_of(entry), []).append(entry)
    for nodes in groups.values():
        if _captures(nodes):
            first = next((node for node in nodes if node.attributes.get("index", "0") == "0"), nodes[0])
            name, model = letters(_camera_of(first).rpartition("/")[2]), first.attributes.get("name", "")
            path = f"/dev/{first.name}"
            camera = _candidate("video", first, usb, path=path, name=name, model=model, function=False)
            yield msgspec.structs.replace(camera, interface=first.name if first.virtual else "")


def _camera_of(node: Entry) -> str:
    """What the nodes of a camera that is not on USB have in common: their device, or the sensor that its driver names."""
    if node.virtual:
        return node.path
    name = node.attributes.get("name", "")
    device = node.path.rpartition("/video4linux/")[0]
    return (
        f"{device}/{name.replace('/', '-')}" if name.startswith("vi-output") else device
    )  # Jetson: one for all sensors


def _captures(nodes: Iterable[Entry]) -> bool:
    told = [node.properties["ID_V4L_CAPABILITIES"] for node in nodes if "ID_V4L_CAPABILITIES" in node.properties]
    if told:
        return any(":capture:" in text for text in told)
    return not all(_NO_CAMERAS.fullmatch(node.attributes.get("name", "").lower()) for node in nodes)


def _serial(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    for entry in entries:
        if entry.attributes.get("console") != "Y":  # the kernel's own
            yield _candidate("serial", entry, usb, path=f"/dev/{entry.name}", name=entry.name, model=entry.driver)


def _can(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    """Network interfaces: without a device file, and with their name as interface, because programs open them by it."""
    for entry in entries:
        model = "vcan" if entry.virtual else entry.driver
        bus = _candidate("can", entry, usb, path="", name=entry.name, model=model)
        yield msgspec.structs.replace(bus, interface=entry.name)


def _gpio(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    for entry in entries:
        yield _candidate("gpio", entry, usb, path=f"/dev/{entry.name}", name=entry.name, model=entry.driver)


def _i2c(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    for entry in entries:
        model = entry.attributes.get("name", "")
        yield _candidate("i2c", entry, usb, path=f"/dev/{entry.name}", name=entry.name, model=model)


def _on_card(bus: Entry, gpus: Iterable[Entry]) -> bool:
    """Whether this I2C bus is one of those by which a graphics card asks what its monitors are."""
    return "/drm/" in bus.path or any(bus.path.startswith(gpu.path.partition("/drm/")[0] + "/") for gpu in gpus)


def _spi(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    """Chips that no driver of the kernel serves: programs may use them through spidev."""
    for entry in entries:
        model = entry.parent_attributes.get("modalias", "").removeprefix("spi:")
        yield _candidate("spi", entry, usb, path=f"/dev/{entry.name}", name=entry.name, model=model)


def _input(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    """Joysticks and gamepads: power buttons, keyboards and mice are nothing a component would ask for."""
    for entry in entries:
        if not (entry.name.startswith("input") and _is_joystick(entry.attributes.get("capabilities/key", ""))):
            continue
        nodes = [node.name for node in entries if node.path.startswith(f"{entry.path}/")]
        node = next((name for name in nodes if name.startswith("js")), nodes[0] if nodes else "")
        attributes = entry.attributes
        path = f"/dev/input/{node}" if node else ""
        pad = _candidate("input", entry, usb, path=path, name=entry.name, model=attributes.get("name", ""))
        yield pad if pad.usb else _without_usb(pad)


def _without_usb(pad: Candidate) -> Candidate:
    """A gamepad on Bluetooth has its address as serial."""
    vendor, product = (pad.entry.attributes.get(f"id/{part}", "").lower() for part in ("vendor", "product"))
    serial = pad.entry.attributes.get("uniq", "")
    name = "-".join(part for part in (letters(vendor), letters(product), letters(serial or pad.model)) if part)
    identity = f"{vendor}:{product}:{serial}".rstrip(":")
    return msgspec.structs.replace(pad, stable_name=name, interface="", identity=identity)


def _is_joystick(keys: str) -> bool:
    """keys: the bit set of an input device as sysfs writes it, words of 64 bit with the highest first."""
    if not _WORDS.fullmatch(keys):
        return False
    bits = 0
    for word in keys.split():
        bits = bits << 64 | int(word, 16)
    return bool(bits & _JOYSTICK_BITS)


def _sound(entries: Sequence[Entry], usb: UsbTree) -> Iterator[Candidate]:
    for entry in entries:
        name = label_value(entry.attributes.get("id", "")) or entry.name
        path = f"/dev/snd/controlC{entry.name.removeprefix('card')}"
        yield _candidate("sound", entry, usb, path=path, name=name, function=False)


def _gpus(entries: Sequence[Entry], snapshot: Snapshot) -> Iterator[Candidate]:
    """Render nodes; without one, the cards that NVIDIA's driver lists, or the GPU of a Jetson."""
    seen: set[str] = set()
    nvidia = False
    for entry in entries:
        parent = entry.parent
        seen.add(parent)
        ids = [_PCI_ID.fullmatch(entry.parent_attributes.get(part, "")) for part in ("vendor", "device")]
        vendor, product = (found[1].lower() if found else "" for found in ids)
        model = _GPU_MODELS.get(vendor, "") or _GPU_DRIVERS.get(entry.driver, "") or label_value(entry.driver)
        nvidia = nvidia or model == "nvidia"
        yield Candidate(
            type="gpu",
            stable_name=f"{letters(model)}-{letters(parent.removeprefix('0000:'))}",
            model=model,
            identity=f"{vendor}:{product}" if vendor and product else "",
            path=f"/dev/dri/{entry.name}",
            entry=entry,
        )
    for address in sorted(set(snapshot.nvidia) - seen):
        if _PCI.fullmatch(address):
            nvidia = True
            yield _plain_gpu(letters(address.removeprefix("0000:")), path="")
    if snapshot.marks and not nvidia:
        yield _plain_gpu("tegra", path=f"/dev/{min(snapshot.marks)}")


def _plain_gpu(name: str, *, path: str) -> Candidate:
    entry = Entry(subsystem="nvidia", name=name, path=f"nvidia/{name}")
    return Candidate(type="gpu", stable_name=f"nvidia-{name}", model="nvidia", path=path, entry=entry)


def _usb_device(entry: Entry, device: Usb, usb: UsbTree) -> Candidate:
    numbers = [entry.attributes.get(part, "") for part in ("busnum", "devnum")]
    known = all(_BUS_NUMBER.fullmatch(number) for number in numbers)
    return Candidate(
        type="usb",
        stable_name=usb.stable_name(device),
        model=label_value(device.model),
        identity=device.identity,
        path="/dev/bus/usb/" + "/".join(number.zfill(3) for number in numbers) if known else "",
        entry=entry,
        usb=device.path,
    )


_KINDS: Final[dict[str, Callable[[Sequence[Entry], UsbTree], Iterator[Candidate]]]] = {
    "video4linux": _video,
    "net": _can,
    "tty": _serial,
    "gpio": _gpio,
    "i2c-dev": _i2c,
    "spidev": _spi,
    "input": _input,
    "sound": _sound,
}
