"""CEL selectors of requests and classes: compiled once per text, evaluated on what a slice says of a device."""

from functools import lru_cache
from typing import Any, Final, NamedTuple

from robotapp_api.values.cel import EvaluationError, ExpressionError, Program, compile_expression
from robotapp_api.values.cel.values import DefaultMap, Semver, get_type, parse_quantity
from robotapp_scheduler.core.dynamic_resources.objects import Device, DeviceAttribute, DeviceId

VARIABLES: Final = frozenset({"device"})
MOST_COMPILED: Final = 1024
"""Compiled selectors that are kept."""
MOST_ROUNDS: Final = 500
"""Rounds of macros on one device, less than a millisecond: a device has 32 attributes and capacities at most."""
HINT: Final = ". consider using CEL optional chaining (.? followed by orValue()) or guarding the check with has() for optional fields"

DeviceInput = dict[str, Any]
"""The variables of an expression."""


class SelectorError(NamedTuple):
    """The reason why a selector has no verdict about a device."""

    text: str
    compiled: bool

    def on_device(self, device: DeviceId) -> str:
        """The rest of kube-scheduler's sentence about the failure."""
        if not self.compiled:
            return f": CEL compile error: {self.text}"
        return f" on device {device}: CEL runtime error: {self.text}"


Verdict = bool | SelectorError


class Selector:
    """A compiled selector."""

    __slots__ = ("_error", "_program", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._program: Program | None = None
        self._error: SelectorError | None = None
        try:
            self._program = compile_expression(text, VARIABLES)
        except ExpressionError as trouble:
            self._error = SelectorError(f"compilation failed: {trouble}", compiled=False)

    def __repr__(self) -> str:
        return f"Selector({self.text!r})"

    @property
    def rounds(self) -> int:
        """Rounds of macros in all evaluations so far."""
        return self._program.rounds if self._program is not None else 0

    def evaluate(self, device: DeviceInput | EvaluationError) -> Verdict:
        """Returns whether the selector matches the device."""
        if self._program is None:
            return self._error or SelectorError("", compiled=False)
        if isinstance(device, EvaluationError):
            return SelectorError(str(device), compiled=True)
        try:
            value = self._program.evaluate(device, MOST_ROUNDS)
        except EvaluationError as trouble:
            text = str(trouble)
            return SelectorError(text + HINT if "no such key:" in text else text, compiled=True)
        if not isinstance(value, bool):
            kind = get_type(value).type_name
            return SelectorError(f"CEL result of type {kind} could not be converted to bool", compiled=True)
        return value


@lru_cache(maxsize=MOST_COMPILED)
def compile_selector(text: str) -> Selector:
    """The selector of a text; equal texts share one."""
    return Selector(text)


def make_input(driver: str, device: Device) -> DeviceInput | EvaluationError:
    """The variables of an expression about the device, or why an attribute of it cannot be read.

    Attributes and capacities stand by domain; the driver's name is the domain of those that have none.
    """
    attributes: DefaultMap = DefaultMap()
    for name, attribute in (device.attributes or {}).items():
        try:
            _put(attributes, name, driver, _read_attribute(attribute))
        except EvaluationError as trouble:
            return EvaluationError(f"attribute {name}: {trouble}")
    capacity: DefaultMap = DefaultMap()
    for name, entry in (device.capacity or {}).items():
        try:
            _put(capacity, name, driver, parse_quantity(str(entry.value)))
        except EvaluationError as trouble:
            return EvaluationError(f"capacity {name}: {trouble}")
    return {
        "device": {
            "driver": driver,
            "allowMultipleAllocations": device.allow_multiple_allocations,
            "attributes": attributes,
            "capacity": capacity,
        }
    }


def _put(by_domain: DefaultMap, name: str, driver: str, value: Any) -> None:
    domain, separator, short_name = name.partition("/")
    if not separator:
        domain, short_name = driver, name
    by_domain.setdefault(domain, {})[short_name] = value


def _read_attribute(attribute: DeviceAttribute) -> Any:
    if attribute.version_value is not None:
        return _read_semver(attribute.version_value)
    if attribute.version_values is not None:
        return [_read_semver(text) for text in attribute.version_values]
    for values in (attribute.int_values, attribute.bool_values, attribute.string_values):
        if values is not None:
            return list(values)
    for value in (attribute.int_value, attribute.bool_value, attribute.string_value):
        if value is not None:
            return value
    raise EvaluationError("unsupported attribute value")


def _read_semver(text: str) -> Semver:
    try:
        return Semver(text)
    except EvaluationError as trouble:
        raise EvaluationError(f"parse semantic version: {trouble}") from None
