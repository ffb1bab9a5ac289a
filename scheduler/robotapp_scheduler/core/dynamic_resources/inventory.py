"""PROVISIONAL: first free devices, no selectors (branch d1 has the real one)."""

from robotapp_scheduler.core.dynamic_resources.objects import DeviceId, DeviceTaintRule, ResourceSlice


class Inventory:
    def __init__(self) -> None:
        self.slices: dict[str, ResourceSlice] = {}

    def apply_slice(self, resource_slice: ResourceSlice) -> tuple[str, ...]:
        self.slices[resource_slice.metadata.name] = resource_slice
        return (resource_slice.spec.node_name,)

    def remove_slice(self, resource_slice: ResourceSlice) -> tuple[str, ...]:
        self.slices.pop(resource_slice.metadata.name, None)
        return (resource_slice.spec.node_name,)

    def apply_taint_rule(self, rule: DeviceTaintRule) -> tuple[str, ...]:  # noqa: ARG002
        return ()

    def remove_taint_rule(self, rule: DeviceTaintRule) -> tuple[str, ...]:  # noqa: ARG002
        return ()

    def node_of(self, device: DeviceId) -> str:
        for each in self.slices.values():
            if (each.spec.driver, each.spec.pool.name) == device[:2]:
                return each.spec.node_name
        return ""
