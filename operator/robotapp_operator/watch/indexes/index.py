"""Indexes of objects by the uid of their app, and by instance."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from typing import TypeVar

from robotapp_claims.rules.objects import Claim
from robotapp_operator.plan.spec.objects import Pod

T = TypeVar("T")
InstanceKey = tuple[str, str]
"""(uid of the app, name of the instance)."""
Changed = Callable[[str, str], None]


class Index(dict[str, dict[str, T]]):
    """Objects by group (an app's uid), then by key; empty groups vanish."""

    def put(self, group: str, key: str, value: T) -> None:
        self.setdefault(group, {})[key] = value

    def drop(self, group: str, key: str) -> None:
        members = self.get(group)
        if members is not None:
            members.pop(key, None)
            if not members:
                del self[group]

    def of(self, group: str) -> Mapping[str, T]:
        return self.get(group, {})


class InstanceIndex(Index[T]):
    """An index that also finds the objects of one instance of an app, however many instances there are.

    instance_of: the instance an object belongs to. changed: called with the app's uid and each instance that has gained,
    lost or changed an object.
    """

    def __init__(self, instance_of: Callable[[T], str], changed: Changed) -> None:
        super().__init__()
        self._instance_of = instance_of
        self._changed = changed
        self._instances: dict[str, Index[T]] = {}

    def put(self, group: str, key: str, value: T) -> None:
        instance = self._instance_of(value)
        before = self.of(group).get(key)
        if before is not None and self._instance_of(before) != instance:
            self._leave(group, key, before)
        super().put(group, key, value)
        self._instances.setdefault(group, Index()).put(instance, key, value)
        self._changed(group, instance)

    def drop(self, group: str, key: str) -> None:
        before = self.of(group).get(key)
        if before is not None:
            self._leave(group, key, before)
        super().drop(group, key)

    def of_instance(self, group: str, instance: str) -> Mapping[str, T]:
        instances = self._instances.get(group)
        return instances.of(instance) if instances else {}

    def instances(self, group: str) -> set[str]:
        """Instances that have an object here."""
        return set(self._instances.get(group, ()))

    def _leave(self, group: str, key: str, before: T) -> None:
        instance = self._instance_of(before)
        instances = self._instances[group]
        instances.drop(instance, key)
        if not instances:
            del self._instances[group]
        self._changed(group, instance)


class PodIndex(InstanceIndex[Pod]):
    """Pods of apps, also by the node they are bound to."""

    def __init__(self, changed: Changed) -> None:
        super().__init__(lambda pod: pod.metadata.instance, changed)
        self._on_node: defaultdict[str, Counter[InstanceKey]] = defaultdict(Counter)

    def put(self, group: str, key: str, value: Pod) -> None:
        self._lift(group, key)
        super().put(group, key, value)
        if value.spec.node_name:
            self._on_node[value.spec.node_name][group, value.metadata.instance] += 1

    def drop(self, group: str, key: str) -> None:
        self._lift(group, key)
        super().drop(group, key)

    def on_node(self, node: str) -> set[InstanceKey]:
        """Instances with a pod bound to `node`."""
        return set(self._on_node.get(node, ()))

    def _lift(self, group: str, key: str) -> None:
        before = self.of(group).get(key)
        if before is None or not before.spec.node_name:
            return
        found = self._on_node[before.spec.node_name]
        entry = group, before.metadata.instance
        found[entry] -= 1
        if not found[entry]:
            del found[entry]
        if not found:
            del self._on_node[before.spec.node_name]


class ClaimIndex(InstanceIndex[Claim]):
    """Claims by the uid of their holder, and by their own name.

    `devices_version` counts up when a device is claimed, freed or has another holder.
    """

    def __init__(self, changed: Changed) -> None:
        super().__init__(lambda claim: claim.holder.instance, changed)
        self.by_name: dict[str, Claim] = {}
        self.devices_version = 0

    def put(self, group: str, key: str, value: Claim) -> None:
        self._count(self.by_name.get(value.name), value)
        super().put(group, key, value)
        self.by_name[value.name] = value

    def drop(self, group: str, key: str) -> None:
        before = self.of(group).get(key)
        super().drop(group, key)
        if before is not None:
            self.by_name.pop(before.name, None)
            self._count(before, None)

    def _count(self, before: Claim | None, now: Claim | None) -> None:
        found = now or before
        if found and found.spec.device and (before and before.spec.holder) != (now and now.spec.holder):
            self.devices_version += 1
