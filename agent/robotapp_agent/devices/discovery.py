"""From a snapshot and the admin's rules to devices with their ids."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Final, NamedTuple

import msgspec

from robotapp_agent.devices.device import MOST_NAMES, Device, device_id
from robotapp_agent.devices.kinds import Candidate, candidates, usb_devices
from robotapp_agent.devices.rules import Rules, apply
from robotapp_agent.devices.tree import MOST_TEXT, Snapshot
from robotapp_agent.devices.usb import UsbTree
from robotapp_api.values.devices.words import AGENT_TYPES
from robotapp_api.values.naming import label_value

NO_RULES: Final = Rules()
USB: Final = "usb"
_LONGEST_IDENTITY: Final = 128
_LONGEST_PATH: Final = 255


class Discovery(NamedTuple):
    """What one scan found, sorted by id, and what is wrong with it."""

    devices: tuple[Device, ...]
    problem: str = ""


class _Ruled(NamedTuple):
    candidate: Candidate
    given: str | None
    """The id that a rule gives."""


def discover(snapshot: Snapshot, rules: Rules = NO_RULES, *, node: str = "") -> Discovery:
    """Depends on nothing but its arguments: the same hardware has the same ids after every reboot.

    Whatever the snapshot's texts are, every device fits the schema of NodeTelemetry.
    """
    usb = UsbTree(snapshot)
    found = candidates(snapshot, usb, extra=rules.subsystems)
    typed = [each for each in found if each.type]
    told = {each.usb for each in typed}
    extra = [each for each in found if not each.type]  # devices only if a rule gives them a type
    extra = _first_named_usb(extra, but={"", *told}, rank=lambda _: 0)
    ruled = [each for each in _apply(rules, extra, snapshot, node=node) if each.candidate.type]
    told |= {each.candidate.usb for each in ruled}
    typed += usb_devices(snapshot, usb, told=told)
    typed = _first_named_usb(typed, but={""}, rank=lambda each: AGENT_TYPES.index(each.type))
    ruled += _apply(rules, typed, snapshot, node=node)
    twice = sorted(name for name, count in Counter(_given(each) for each in ruled if each.given).items() if count > 1)
    devices: dict[str, Device] = {}
    for each in ruled:
        device = _device(each, plain=not each.given or _given(each) in twice)
        if device.id in devices:  # two that nothing tells apart: the kernel's name must do
            device = msgspec.structs.replace(
                device, id=device_id(device.type, f"{device.id}-{each.candidate.entry.name}")
            )
        devices.setdefault(device.id, device)
    problem = f"id {twice[0]} of a rule fits several devices, which keep their own: match only one" if twice else ""
    return Discovery(tuple(devices[name] for name in sorted(devices)), problem or snapshot.problem)


def _apply(rules: Rules, found: Iterable[Candidate], snapshot: Snapshot, *, node: str) -> list[_Ruled]:
    ruled = (apply(rules, each, snapshot, node=node) for each in found)
    return [_Ruled(*each) for each in ruled if each is not None]


def _first_named_usb(
    found: Sequence[Candidate], *, but: Collection[str], rank: Callable[[Candidate], int]
) -> list[Candidate]:
    """The first function of every USB device goes by the name `usb` too: asked for by vid:pid it is that one device."""
    first: dict[str, int] = {}
    for position, each in sorted(enumerate(found), key=lambda item: (rank(item[1]), item[0])):
        if each.usb not in but:
            first.setdefault(each.usb, position)
    chosen = set(first.values())
    return [msgspec.structs.replace(each, names=(USB,)) if i in chosen else each for i, each in enumerate(found)]


def _given(ruled: _Ruled) -> str:
    return f"{ruled.candidate.type}-{ruled.given}"


def _device(ruled: _Ruled, *, plain: bool) -> Device:
    found = ruled.candidate
    stable_name = found.stable_name if plain or ruled.given is None else ruled.given
    names = tuple(name for name in found.names if name != found.type)[:MOST_NAMES]
    return Device(
        id=device_id(found.type, stable_name),
        type=found.type,
        model=label_value(found.model),
        interface=label_value(found.interface),
        identity=_printable(found.identity)[:_LONGEST_IDENTITY],
        path=_printable(found.path)[:_LONGEST_PATH],
        names=names,
    )


def _printable(text: str) -> str:
    return "".join(character for character in text[:MOST_TEXT] if character.isprintable())
