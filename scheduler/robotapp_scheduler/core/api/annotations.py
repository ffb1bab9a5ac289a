"""Strict, bounded reading of the scheduler.robotics.io annotations.

Nothing is guessed: what cannot be used becomes an `InvalidAnnotation` that names key, field, value and what is
allowed. Size, depth and number ranges are checked before or while parsing, so a hostile annotation costs microseconds.
"""

import json
from collections.abc import Callable, Mapping
from typing import Any, Final

from robotapp_api.model.names import SAFE_IDS, Annotation
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.ranges import is_safe_id
from robotapp_scheduler.core.api.ros import TIERS, Hardware, InvalidAnnotation, RosRequest

MAX_BYTES: Final = 8 * 1024
MAX_DEPTH: Final = 6
MAX_ITEMS: Final = 32
MAX_TEXT: Final = 253
_SHOWN: Final = 80

READ: Final = (
    Annotation.POLICIES,
    Annotation.TOPOLOGY,
    Annotation.AFFINITY,
    Annotation.SHARED_DATA,
    Annotation.DDS_DOMAIN,
)
_READ: Final = frozenset(READ)


class _InvalidValue(Exception):  # noqa: N818 - control flow inside this module, never seen outside
    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(field, value, allowed)
        self.field, self.value, self.allowed = field, value, allowed


def any_read(annotations: Mapping[str, str]) -> bool:
    """Is there a ROS annotation among these?"""
    return not _READ.isdisjoint(annotations)


def parse_annotations(annotations: Mapping[str, str]) -> RosRequest | InvalidAnnotation | None:
    """All ROS annotations of a pod; None when it has none of them."""
    if not any_read(annotations):
        return None
    present = [key for key in READ if key in annotations]
    fields: dict[str, Any] = {}
    for key in present:
        try:
            fields.update(_PARSERS[key](annotations[key]))
        except _InvalidValue as refused:
            return InvalidAnnotation(
                key=str(key), field=refused.field, value=_shown(refused.value), allowed=refused.allowed
            )
    return RosRequest(**fields)


def _shown(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=True, default=str)
    text = f'"{text}"' if isinstance(value, str) else text
    return text if len(text) <= _SHOWN else text[: _SHOWN - 4] + " ..."


# --- JSON, bounded ---------------------------------------------------------------------------------------------------


def _check_size(text: str) -> None:
    if len(text) > MAX_BYTES or len(text.encode(errors="replace")) > MAX_BYTES:
        raise _InvalidValue("", text, f"at most {MAX_BYTES} bytes of JSON")
    depth = 0
    quoted = escaped = False
    for char in text:
        if quoted:
            quoted = char != '"' or escaped
            escaped = char == "\\" and not escaped
        elif char == '"':
            quoted = True
        elif char in "[{":
            depth += 1
            if depth > MAX_DEPTH:
                raise _InvalidValue("", text, f"at most {MAX_DEPTH} levels of nesting")
        elif char in "]}":
            depth -= 1


def _no_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise _InvalidValue(key, value, "each field once")
        result[key] = value
    return result


def _no_constant(text: str) -> Any:
    raise _InvalidValue("", text, "numbers (NaN and Infinity are not JSON)")


def _bounded_int(text: str) -> int:
    if len(text) > 10:
        raise _InvalidValue("", text, "integers of at most 9 digits")
    return int(text)


def _bounded_float(text: str) -> float:
    value = float(text)
    if len(text) > 24 or abs(value) > 1e9:
        raise _InvalidValue("", text, "numbers up to 1e9")
    return value


_DECODER: Final = json.JSONDecoder(
    object_pairs_hook=_no_duplicates,
    parse_constant=_no_constant,
    parse_int=_bounded_int,
    parse_float=_bounded_float,
)


def _object(text: str, known: Mapping[str, Callable[[str, Any], Any]]) -> dict[str, Any]:
    """The known fields of a JSON object, each through its check; null counts as absent."""
    _check_size(text)
    try:
        raw = _DECODER.decode(text)
    except json.JSONDecodeError as error:
        raise _InvalidValue("", text, f"a JSON object ({error.msg} at character {error.pos})") from None
    if not isinstance(raw, dict):
        raise _InvalidValue("", raw, "a JSON object")
    found: dict[str, Any] = {}
    for field, value in raw.items():
        check = known.get(field)
        if check is None:
            raise _InvalidValue(field, value, "one of " + ", ".join(sorted(known)))
        if value is not None:
            found[field] = check(field, value)
    return found


# --- Checks of single values -----------------------------------------------------------------------------------------


def _text(field: str, value: Any) -> str:
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        raise _InvalidValue(field, value, f"a string of at most {MAX_TEXT} characters")
    return value


def _required_text(field: str, value: Any) -> str:
    if not _text(field, value):
        raise _InvalidValue(field, value, "a non-empty string")
    return str(value)


def _texts(field: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) > MAX_ITEMS:
        raise _InvalidValue(field, value, f"a list of at most {MAX_ITEMS} strings")
    return tuple(_required_text(f"{field}[{i}]", item) for i, item in enumerate(value))


def _duration(field: str, value: Any) -> int:
    allowed = "a positive duration with a unit, such as 30ms or 1.5s"
    if not isinstance(value, str):
        raise _InvalidValue(field, value, allowed)
    try:
        duration_us = parse_us(_text(field, value))
    except ValueError:
        raise _InvalidValue(field, value, allowed) from None
    if duration_us <= 0:
        raise _InvalidValue(field, value, allowed)
    return duration_us


def _one_of(*allowed: str) -> Callable[[str, Any], str]:
    def check(field: str, value: Any) -> str:
        if value not in allowed or not isinstance(value, str):
            raise _InvalidValue(field, value, "one of " + ", ".join(allowed))
        return value

    return check


def _count(field: str, value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= 1_000_000:
        raise _InvalidValue(field, value, "an integer from 0 to 1000000")
    return value


def _flag(field: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise _InvalidValue(field, value, "true or false")
    return value


def _hardware(field: str, value: Any) -> tuple[Hardware, ...]:
    if not isinstance(value, list) or len(value) > MAX_ITEMS:
        raise _InvalidValue(field, value, f"a list of at most {MAX_ITEMS} requirements")
    return tuple(_requirement(f"{field}[{i}]", item) for i, item in enumerate(value))


def _requirement(field: str, item: Any) -> Hardware:
    known = ("type", "model", "interface")
    if not isinstance(item, dict):
        raise _InvalidValue(field, item, "an object with " + ", ".join(known))
    for name in item:
        if name not in known:
            raise _InvalidValue(f"{field}.{name}", item[name], "one of " + ", ".join(known))
    values = {name: _text(f"{field}.{name}", item[name]) for name in known if item.get(name) is not None}
    if not values.get("type"):
        raise _InvalidValue(f"{field}.type", item.get("type"), "a device type such as gpu, usb, can, serial or gpio")
    return Hardware(**values)


# --- One parser per annotation -----------------------------------------------------------------------------------------

_POLICIES: Final[dict[str, Callable[[str, Any], Any]]] = {
    "latency_budget": _duration,
    "deadline": _duration,
    "qos_class": _one_of(*TIERS),
    "reliability": _one_of("reliable", "best_effort", "system_default"),
    "durability": _one_of("volatile", "transient_local", "system_default"),
    "liveliness": _one_of("automatic", "manual_by_topic", "system_default"),
    "queue_size": _count,
    "tcp_nodelay": _flag,
}
_TOPOLOGY: Final[dict[str, Callable[[str, Any], Any]]] = {"master_node": _text, "preferred_zones": _texts}
_AFFINITY: Final[dict[str, Callable[[str, Any], Any]]] = {"hardware_requirements": _hardware}
_SHARED: Final[dict[str, Callable[[str, Any], Any]]] = {"peer_pods": _texts, "pvc": _texts}

_RENAMED: Final = {
    "latency_budget": "latency_budget_us",
    "deadline": "deadline_us",
    "preferred_zones": "zones",
    "hardware_requirements": "hardware",
    "pvc": "volume_claims",
}
_IGNORED: Final = frozenset({"durability", "queue_size", "tcp_nodelay"})
"""Checked, but the scheduler has no use for them."""


def _reader(known: Mapping[str, Callable[[str, Any], Any]]) -> Callable[[str], dict[str, Any]]:
    def read(text: str) -> dict[str, Any]:
        found = _object(text, known)
        return {_RENAMED.get(name, name): value for name, value in found.items() if name not in _IGNORED}

    return read


def _domain(text: str) -> dict[str, Any]:
    # Slicing first: a hostile value may be 256 KiB long, and only its length matters then.
    value = text.strip() if len(text) <= 8 else text
    if value == "auto":
        return {"dds_domain": value}
    if value.isascii() and value.isdigit() and len(value) <= 3 and is_safe_id(int(value)):
        return {"dds_domain": str(int(value))}
    # Unsafe ids need a field that allows them, which only a RobotApp has (ros2.allowUnsafeDomain).
    raise _InvalidValue("", text, f'"auto" or a number of {SAFE_IDS}')


_PARSERS: Final[dict[Annotation, Callable[[str], dict[str, Any]]]] = {
    Annotation.POLICIES: _reader(_POLICIES),
    Annotation.TOPOLOGY: _reader(_TOPOLOGY),
    Annotation.AFFINITY: _reader(_AFFINITY),
    Annotation.SHARED_DATA: _reader(_SHARED),
    Annotation.DDS_DOMAIN: _domain,
}
