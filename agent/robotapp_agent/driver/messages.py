"""The few protobuf messages of the kubelet's plugin interfaces (k8s.io/kubelet pkg/apis/{dra,pluginregistration}/v1). Pure.

Written by hand: five messages of texts cost less than a generated module with its library in the memory of every robot.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

_BYTES: Final = 2
"""Wire type of texts and messages."""
_FIXED: Final = {1: 8, 5: 4}
"""Wire types of a fixed length, in bytes."""
_LONGEST_VARINT: Final = 10


class ClaimReference(NamedTuple):
    """A claim as the kubelet names it."""

    namespace: str
    uid: str
    name: str


class DeviceAnswer(NamedTuple):
    """A prepared device: the runtime finds it under its CDI id."""

    request: str
    pool: str
    device: str
    cdi_id: str


class RegistrationStatus(NamedTuple):
    """The kubelet's verdict on our registration."""

    registered: bool
    error: str


PrepareAnswers = Mapping[str, tuple[DeviceAnswer, ...] | str]
"""By uid of a claim its devices, or the error."""


def decode_claims(message: bytes) -> tuple[ClaimReference, ...]:
    """The claims of NodePrepareResourcesRequest and NodeUnprepareResourcesRequest. Raises ValueError."""
    claims = []
    for number, value in _fields(message):
        if number == 1 and isinstance(value, bytes):
            texts = {key: text.decode() for key, text in _fields(value) if isinstance(text, bytes)}
            claims.append(ClaimReference(namespace=texts.get(1, ""), uid=texts.get(2, ""), name=texts.get(3, "")))
    return tuple(claims)


def encode_prepared(answers: PrepareAnswers) -> bytes:
    """Returns a NodePrepareResourcesResponse."""
    return b"".join(_entry(uid, _prepared(answer)) for uid, answer in answers.items())


def encode_unprepared(errors: Mapping[str, str]) -> bytes:
    """Returns a NodeUnprepareResourcesResponse: by uid of a claim its error, "" when its devices are given back."""
    return b"".join(_entry(uid, _text(1, error)) for uid, error in errors.items())


def encode_plugin_info(*, kind: str, name: str, endpoint: str, versions: Iterable[str]) -> bytes:
    """PluginInfo of the registration."""
    version_fields = b"".join(_text(4, version) for version in versions)
    return _text(1, kind) + _text(2, name) + _text(3, endpoint) + version_fields


def decode_registration_status(message: bytes) -> RegistrationStatus:
    """Raises ValueError."""
    is_registered, error = False, ""
    for number, value in _fields(message):
        if number == 1 and isinstance(value, int):
            is_registered = bool(value)
        elif number == 2 and isinstance(value, bytes):
            error = value.decode()
    return RegistrationStatus(is_registered, error)


def _prepared(answer: tuple[DeviceAnswer, ...] | str) -> bytes:
    if isinstance(answer, str):
        return _text(2, answer)
    return b"".join(
        _message(
            1, _text(1, device.request) + _text(2, device.pool) + _text(3, device.device) + _text(4, device.cdi_id)
        )
        for device in answer
    )


def _entry(key: str, value: bytes) -> bytes:
    """An entry of field 1, a map with texts as keys and messages as values."""
    return _message(1, _text(1, key) + _message(2, value))


def _text(number: int, text: str) -> bytes:
    return _message(number, text.encode()) if text else b""


def _message(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | _BYTES) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    octets = bytearray()
    while value > 0x7F:
        octets.append(value & 0x7F | 0x80)
        value >>= 7
    octets.append(value)
    return bytes(octets)


def _fields(message: bytes) -> Iterator[tuple[int, bytes | int]]:
    """Number and value of each field; unknown ones are for the caller to leave alone. Raises ValueError."""
    position = 0
    while position < len(message):
        key, position = _read_varint(message, position)
        number, wire_type = key >> 3, key & 7
        if wire_type == 0:
            value, position = _read_varint(message, position)
            yield number, value
            continue
        length = _FIXED.get(wire_type, 0)
        if wire_type == _BYTES:
            length, position = _read_varint(message, position)
        elif not length:
            raise ValueError(f"wire type {wire_type} is not used in these messages")
        if position + length > len(message):
            raise ValueError("the message ends within a field")
        yield number, message[position : position + length]
        position += length


def _read_varint(message: bytes, position: int) -> tuple[int, int]:
    value = 0
    for count in range(_LONGEST_VARINT):
        if position >= len(message):
            raise ValueError("the message ends within a number")
        octet = message[position]
        position += 1
        value |= (octet & 0x7F) << (7 * count)
        if octet < 0x80:
            return value, position
    raise ValueError("a number is longer than ten bytes")
