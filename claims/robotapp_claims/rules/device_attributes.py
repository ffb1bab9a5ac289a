"""Attributes of a device in a ResourceSlice, and the CEL selector that finds by them what a RobotApp wishes for.

Driver, operator and testbed share both, so that a wish matches the same devices as `fits_kind` does for RobotClaims.
"""

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from robotapp_api.model.names import Label
from robotapp_api.values.devices.words import list_interfaces, list_models, list_types
from robotapp_claims.rules.device import Described, Kind, split_identity
from robotapp_claims.rules.identity import device_label, hash10
from robotapp_claims.rules.objects import (
    Claim,
    ClaimSpec,
    ClaimStatus,
    DeviceThing,
    Holder,
    Meta,
    ResourceClaim,
)

DRIVER: Final = "devices.robotics.io"
"""Name of our DRA driver, of its DeviceClass, and domain of the attributes."""
MOST_ATTRIBUTES: Final = 32
"""Of one device, by the API."""
LONGEST_TEXT: Final = 64
"""Bytes of an attribute's value, by the API: one device with more would keep all of its slice from being published."""
_LONGEST_ID: Final = 32
"""Characters of an attribute's name, which must be a C identifier."""
_PLAIN_NAME: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_ATTRIBUTES: Final = f'device.attributes["{DRIVER}"]'

_HELD_NAME: Final = "resourceclaim/"

Attributes = dict[str, dict[str, Any]]


def attributes_of(device: Described, *, path: str = "") -> Attributes:
    """Attributes of a device in the form of the API. What is unknown is absent.

    `name_…` stands for a further name of the device: true for a whole name, false for the words that one begins with.
    """
    vendor, product, serial = split_identity(device.identity) or ("", "", "")
    texts = {
        "type": device.type,
        "model": device.model,
        "interface": device.interface,
        "vendor": vendor,
        "product": product,
        "serial": serial,
        "path": path,
    }
    attributes: Attributes = {key: {"string": cut_text(text)} for key, text in texts.items() if text}
    words = {word: False for name in device.names for word in _beginnings(name)} | dict.fromkeys(device.names, True)
    whole_first = sorted(words, key=lambda word: (not words[word], word))
    for word in whole_first[: MOST_ATTRIBUTES - len(texts)]:
        attributes[name_attribute(word)] = {"bool": words[word]}
    return attributes


def cut_text(text: str) -> str:
    """Returns as much of a text as an attribute holds, in whole characters."""
    return text.encode(errors="replace")[:LONGEST_TEXT].decode(errors="ignore")


def name_attribute(word: str) -> str:
    """Name of the attribute that stands for a further name: itself where it fits, else a hash."""
    attribute = f"name_{word.replace('-', '_')}"
    return attribute if _PLAIN_NAME.fullmatch(word) and len(attribute) <= _LONGEST_ID else f"named_{hash10(word)}"


def selector_of(wish: Kind) -> str:
    """CEL expression that holds for the devices that `fits_kind` accepts."""
    words = [
        _kind_condition(kind, interface)
        for kind in list_types(wish.type)
        for interface in list_interfaces(wish.interface)
    ]
    conditions = [f"({' || '.join(words)})"]
    if wish.model:
        conditions.append(_equals("model", *list_models(wish.model)))
    identity = split_identity(wish.usb_id or "")
    if identity:
        conditions += [_equals("vendor", identity.vendor), _equals("product", identity.product)]
        if identity.serial:
            conditions.append(_equals("serial", identity.serial))
    elif wish.usb_id:
        conditions.append("false")
    return " && ".join([f'device.driver == "{DRIVER}"', *conditions])


def _kind_condition(kind: str, interface: str) -> str:
    if interface:
        name = name_attribute(f"{kind}-{interface}")
        type_condition = f"{_equals('type', kind)} && {_equals('interface', interface)}"
        return f'{type_condition} || "{name}" in {_ATTRIBUTES} && {_ATTRIBUTES}["{name}"] == true'
    return f'{_equals("type", kind)} || "{name_attribute(kind)}" in {_ATTRIBUTES}'


def _equals(attribute: str, *texts: str) -> str:
    """CEL that holds where the attribute is one of the texts, each as JSON, whose escapes CEL has, too."""
    literals = [json.dumps(cut_text(text), ensure_ascii=False) for text in texts]
    value = f'{_ATTRIBUTES}["{attribute}"]'
    comparison = f"{value} == {literals[0]}" if len(literals) == 1 else f"{value} in [{', '.join(literals)}]"
    return f'"{attribute}" in {_ATTRIBUTES} && {comparison}'


def _beginnings(name: str) -> Iterator[str]:
    """The words that a name begins with: of sensor-usb-cam these are sensor and sensor-usb."""
    end = name.find("-")
    while end >= 0:
        yield name[:end]
        end = name.find("-", end + 1)


def list_held(claim: ResourceClaim) -> tuple[Claim, ...]:
    """Returns the devices of our driver that a ResourceClaim holds, in the form of RobotClaims: one rule shows both ledgers.

    The pool is the node and the device the id that the agent reports, as the driver publishes them. Names have slashes, which no
    RobotClaim has.
    """
    if claim.status.allocation is None:
        return ()
    holder, meta = _holder_of(claim), claim.metadata
    pod = next((user.uid for user in claim.status.reserved_for if user.resource == "pods" and not user.api_group), "")
    return tuple(
        Claim(
            metadata=Meta(name=f"{_HELD_NAME}{meta.namespace}/{meta.name}/{result.device}", uid=meta.uid),
            spec=ClaimSpec(
                holder=holder,
                device=DeviceThing(
                    node=result.pool, type=result.device.partition("-")[0], id=device_label(result.device)
                ),
            ),
            status=ClaimStatus(node=result.pool, pod=pod),
        )
        for result in claim.status.allocation.devices.results
        if result.driver == DRIVER and not result.admin_access
    )


def _holder_of(claim: ResourceClaim) -> Holder:
    """The RobotApp that controls the claim, else the claim itself."""
    meta, owner = claim.metadata, claim.metadata.controller
    if owner is not None and owner.is_app:
        return Holder(
            api_version=owner.api_version,
            kind=owner.kind,
            namespace=meta.namespace,
            name=owner.name,
            uid=owner.uid,
            instance=meta.instance,
            component=meta.labels.get(Label.COMPONENT, ""),
        )
    return Holder(
        api_version="resource.k8s.io/v1", kind="ResourceClaim", namespace=meta.namespace, name=meta.name, uid=meta.uid
    )
