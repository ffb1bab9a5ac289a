"""Constraints between the devices of a claim: one value of an attribute for all, or a different one for each."""

from typing import Final

from robotapp_scheduler.core.dynamic_resources.objects import DeviceAttribute, DeviceConstraint
from robotapp_scheduler.core.dynamic_resources.offered_devices import OfferedDevice

ScalarValue = tuple[str, int | bool | str]
"""Kind and value: a version never equals a string."""
INCOMPARABLE: Final = None
"""Value of an attribute that has several values."""


class Constraint:
    """A constraint and the values of the devices that were added to it. Adding a device never makes a broken one hold."""

    __slots__ = (
        "_depths",
        "_requests",
        "_value_of",
        "_values",
        "attribute",
        "conflict",
        "is_distinct",
        "usable_values",
    )

    def __init__(self, constraint: DeviceConstraint) -> None:
        self.is_distinct = constraint.match_attribute is None
        self.attribute = constraint.match_attribute or constraint.distinct_attribute or ""
        self.usable_values: frozenset[ScalarValue | None] | None = None
        """The values with which the constraint can hold at all, None for any."""
        self.conflict = 0
        """The choice, as a bit by its depth, against which the last refused device stands; 0 when it can never be added."""
        self._requests = frozenset(constraint.requests)
        self._value_of: dict[OfferedDevice, tuple[bool, ScalarValue | None]] = {}
        """Results of `get_value`, which a search wants again and again."""
        self._values: list[ScalarValue | None] = []
        self._depths: list[int] = []

    def __repr__(self) -> str:
        return f"Constraint({self.attribute}, {'distinct' if self.is_distinct else 'match'}, {self._values})"

    def applies_to(self, request: str, name: str) -> bool:
        """Returns whether the constraint is about devices of this request, or of this subrequest of it."""
        return not self._requests or request in self._requests or name in self._requests

    def get_value(self, offered_device: OfferedDevice) -> tuple[bool, ScalarValue | None]:
        """Returns whether the device has the attribute, and its value."""
        result = self._value_of.get(offered_device)
        if result is None:
            attribute = lookup_attribute(offered_device, self.attribute)
            result = (True, get_scalar_value(attribute)) if attribute is not None else (False, INCOMPARABLE)
            self._value_of[offered_device] = result
        return result

    def add(self, offered_device: OfferedDevice, depth: int) -> bool:
        """Adds the device if the constraint still holds with it, else sets `conflict`."""
        exists, value = self.get_value(offered_device)
        self.conflict = 0
        if not exists or (self.usable_values is not None and value not in self.usable_values):
            return False
        blocking = self._find_blocking(value)
        if blocking is not None:
            self.conflict = 1 << self._depths[blocking]
            return False
        self._values.append(value)
        self._depths.append(depth)
        return True

    def remove_last(self) -> None:
        """Takes the device out that was added last."""
        self._values.pop()
        self._depths.pop()

    def _find_blocking(self, value: ScalarValue | None) -> int | None:
        """The position of a device beside which none of this value can stand."""
        if not self._values:
            return None
        if value is INCOMPARABLE:
            return 0
        if self.is_distinct:
            return self._values.index(value) if value in self._values else None
        return 0 if value != self._values[0] else None


def lookup_attribute(offered_device: OfferedDevice, name: str) -> DeviceAttribute | None:
    """The attribute by its full name. The driver's name stands for the domain of attributes that have none."""
    attributes = offered_device.device.attributes or {}
    attribute = attributes.get(name)
    if attribute is None:
        domain, separator, short_name = name.partition("/")
        if separator and domain == offered_device.id.driver:
            return attributes.get(short_name)
    return attribute


def get_scalar_value(attribute: DeviceAttribute) -> ScalarValue | None:
    """Kind and value, None for a list."""
    if attribute.string_value is not None:
        return "string", attribute.string_value
    if attribute.int_value is not None:
        return "int", attribute.int_value
    if attribute.bool_value is not None:
        return "bool", attribute.bool_value
    if attribute.version_value is not None:
        return "version", attribute.version_value
    return INCOMPARABLE
