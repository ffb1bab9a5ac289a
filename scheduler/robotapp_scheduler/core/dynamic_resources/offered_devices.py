"""The devices of one slice, prepared once for the many nodes and requests that look at them."""

from collections.abc import Iterable
from typing import Final

from robotapp_api.values.cel import EvaluationError
from robotapp_scheduler.core.dynamic_resources.objects import (
    Device,
    DeviceId,
    DeviceTaint,
    DeviceTaintRule,
    DeviceToleration,
    ResourceSlice,
)
from robotapp_scheduler.core.dynamic_resources.selectors import DeviceInput, Selector, Verdict, make_input

MOST_SELECTORS: Final = 256
"""Selectors whose verdicts about a slice are kept; a user can make any number of claims with selectors of their own."""
BLOCKING_EFFECTS: Final = frozenset({"NoSchedule", "NoExecute"})
"""Other effects, None among them, keep no device from being allocated."""


class OfferedDevice:
    """A device that can be allocated, unless `unserved` names a reason against it."""

    __slots__ = ("_index", "_input", "device", "id", "offer", "taints", "unserved")

    def __init__(self, device: Device, offer: "SliceOffer", index: int) -> None:
        self._index = index
        self._input: DeviceInput | EvaluationError | None = None
        self.id = DeviceId(offer.driver, offer.pool, device.name)
        self.device = device
        self.offer = offer
        self.taints: tuple[DeviceTaint, ...] = ()
        """Taints of the device and of rules that must be tolerated."""
        self.unserved = explain_unserved(device)

    def __repr__(self) -> str:
        return f"OfferedDevice({self.id})"

    def verdict_of(self, selector: Selector) -> Verdict:
        """Returns what the selector decides about the device; it is evaluated once."""
        verdicts = self.offer.verdicts_of(selector)
        verdict = verdicts[self._index]
        if verdict is None:
            if self._input is None:
                self._input = make_input(self.id.driver, self.device)
            verdict = verdicts[self._index] = selector.evaluate(self._input)
        return verdict


class SliceOffer:
    """The devices of a ResourceSlice in their order, and what selectors have decided about them."""

    __slots__ = ("_verdicts", "devices", "driver", "has_binding_conditions", "name", "pool", "resource_slice")

    def __init__(self, resource_slice: ResourceSlice) -> None:
        spec = resource_slice.spec
        self.resource_slice = resource_slice
        self.name = resource_slice.metadata.name
        self.driver = spec.driver
        self.pool = spec.pool.name
        self.devices = tuple(OfferedDevice(device, self, index) for index, device in enumerate(spec.devices))
        self.has_binding_conditions = any(device.binding_conditions for device in spec.devices)
        self._verdicts: dict[Selector, list[Verdict | None]] = {}

    def __repr__(self) -> str:
        return f"SliceOffer({self.name}, {len(self.devices)} devices)"

    def apply_taints(self, rules: Iterable[DeviceTaintRule]) -> None:
        """Sets the taints of each device: its own, then those of the rules that select it."""
        rules = [rule for rule in rules if selects_pool(rule, self.driver, self.pool)]
        for offered_device in self.devices:
            taints = [
                *offered_device.device.taints,
                *(rule.spec.taint for rule in rules if selects_device(rule, offered_device.device.name)),
            ]
            offered_device.taints = tuple(taint for taint in taints if taint.effect in BLOCKING_EFFECTS)

    def verdicts_of(self, selector: Selector) -> list[Verdict | None]:
        """Returns what the selector has decided about each device; None stands for a device it was not evaluated on yet."""
        verdicts = self._verdicts.get(selector)
        if verdicts is None:
            if len(self._verdicts) >= MOST_SELECTORS:
                self._verdicts.clear()
            verdicts = self._verdicts[selector] = [None] * len(self.devices)
        return verdicts


def explain_unserved(device: Device) -> str:
    """Returns why this scheduler cannot allocate the device, "" when it can."""
    if device.consumes_counters:
        return "it is a partition of a larger device (consumesCounters)"
    if device.allow_multiple_allocations:
        return "it is shared by capacity (allowMultipleAllocations)"
    if device.binding_conditions:
        return "it is prepared after the allocation (bindingConditions)"
    return ""


def selects_pool(rule: DeviceTaintRule, driver: str, pool: str) -> bool:
    """Returns whether the rule can concern devices of the pool."""
    selector = rule.spec.device_selector
    return selector is not None and selector.driver in {None, driver} and selector.pool in {None, pool}


def selects_device(rule: DeviceTaintRule, device: str) -> bool:
    """Returns whether the rule, which selects the pool, concerns the device."""
    selector = rule.spec.device_selector
    return selector is not None and selector.device in {None, device}


def tolerates_all(tolerations: Iterable[DeviceToleration], taints: Iterable[DeviceTaint]) -> bool:
    """Returns whether each of the taints is tolerated."""
    return all(any(tolerates(toleration, taint) for toleration in tolerations) for taint in taints)


def tolerates(toleration: DeviceToleration, taint: DeviceTaint) -> bool:
    """Returns whether the toleration covers the taint. An empty key or effect covers all keys or effects."""
    if toleration.effect not in {"", taint.effect} or toleration.key not in {"", taint.key}:
        return False
    if toleration.operator in {"", "Equal"}:
        return toleration.value == taint.value
    return toleration.operator == "Exists"
