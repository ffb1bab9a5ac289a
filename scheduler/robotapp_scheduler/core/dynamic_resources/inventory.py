"""The devices of the cluster by node: complete pools of the newest generation, with the taints of rules."""

from collections.abc import Iterable

from robotapp_scheduler.core.dynamic_resources.objects import DeviceId, DeviceTaintRule, ResourceSlice


class Inventory:
    """ResourceSlices and DeviceTaintRules as the watch has them, and the pools that follow from them."""

    def apply_slice(self, resource_slice: ResourceSlice) -> Iterable[str] | None:
        """Adds or replaces a slice. Returns the names of nodes whose devices may have changed, None for any node."""
        raise NotImplementedError

    def remove_slice(self, resource_slice: ResourceSlice) -> Iterable[str] | None:
        """Removes a slice; result as for `apply_slice`."""
        raise NotImplementedError

    def apply_taint_rule(self, rule: DeviceTaintRule) -> Iterable[str] | None:
        """Adds or replaces a rule; result as for `apply_slice`."""
        raise NotImplementedError

    def remove_taint_rule(self, rule: DeviceTaintRule) -> Iterable[str] | None:
        """Removes a rule; result as for `apply_slice`."""
        raise NotImplementedError

    def node_of(self, device: DeviceId) -> str:
        """The only node that can reach the device's pool, "" when there are several, or none is named."""
        raise NotImplementedError
