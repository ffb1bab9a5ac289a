"""Constraints between the devices of a claim: one value of an attribute for all, or a different one for each."""

from typing import Final

from robotapp_scheduler.core.dynamic_resources.objects import DeviceAttribute, DeviceConstraint
from robotapp_scheduler.core.dynamic_resources.offered_devices import OfferedDevice

ScalarValue = tuple[str, int | bool | str]
"""Kind and value: a version never equals a string."""
INCOMPARABLE: Final = None
"""Value of an attribute that has several values."""


class Constraint:
    """A constraint and the values of the devices that were passed_constraints to it. Adding a device never makes a broken one hold."""

    __slots__ = ("_attribute", "_distinct", "_requests", "_values")

    def __init__(self, constraint: DeviceConstraint) -> None:
        self._distinct = constraint.match_attribute is None
        self._attribute = constraint.match_attribute or constraint.distinct_attribute or ""
        self._requests = frozenset(constraint.requests)
        self._values: list[ScalarValue | None] = []

    def __repr__(self) -> str:
        return f"Constraint({self._attribute}, {'distinct' if self._distinct else 'match'}, {self._values})"

    def applies_to(self, request: str, name: str) -> bool:
        """Returns whether the constraint is about devices of this request, or of this subrequest of it."""
        return not self._requests or request in self._requests or name in self._requests

    def add(self, offered_device: OfferedDevice) -> bool:
        """Adds the device if the constraint still holds with it."""
        attribute = lookup_attribute(offered_device, self._attribute)
        if attribute is None:
            return False
        value = get_scalar_value(attribute)
        if self._distinct:
            fits = value not in self._values if value is not INCOMPARABLE else not self._values
        else:
            fits = not self._values or (value is not INCOMPARABLE and value == self._values[0])
        if fits:
            self._values.append(value)
        return fits

    def remove_last(self) -> None:
        """Takes the device out that was passed_constraints last."""
        self._values.pop()


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
