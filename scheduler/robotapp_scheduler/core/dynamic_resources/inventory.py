"""The devices of the cluster by node: complete pools of the newest generation, with the taints of rules."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

from robotapp_api.values.selector import matches_node_terms
from robotapp_scheduler.core.api.core_v1 import NodeSelector
from robotapp_scheduler.core.dynamic_resources.objects import Device, DeviceId, DeviceTaintRule, ResourceSlice
from robotapp_scheduler.core.dynamic_resources.offered_devices import SliceOffer, selects_pool

PoolKey = tuple[str, str]
"""(driver, name of the pool)."""
NONE_CONCERNED: tuple[str, ...] = ()


class TargetNode(NamedTuple):
    """The node for which devices are chosen."""

    name: str
    labels: Mapping[str, str]


class NodePool(NamedTuple):
    """The part of a pool that one node can reach. From an incomplete or invalid pool nothing may be allocated."""

    driver: str
    name: str
    offers: tuple[SliceOffer, ...] = ()
    """By name of the slice."""
    incomplete: bool = False
    invalid: bool = False

    def __str__(self) -> str:
        return f"{self.driver}/{self.name}"


class PoolSlices:
    """All slices of one pool, of whatever generation."""

    __slots__ = ("key", "offers")

    def __init__(self, key: PoolKey) -> None:
        self.key = key
        self.offers: dict[str, SliceOffer] = {}

    def __repr__(self) -> str:
        return f"PoolSlices({self.key}, {len(self.offers)} slices)"

    def node_names(self) -> set[str] | None:
        """The nodes that reach the pool, None when a slice selects nodes in another way than by name."""
        names = {offer.resource_slice.spec.node_name for offer in self.offers.values()}
        return None if "" in names else names

    def get_node_pool(self, node: TargetNode) -> NodePool | None:
        """The pool as the node sees it, None when it offers nothing there or is being replaced by a newer generation."""
        offers = [offer for offer in self.offers.values() if reaches(offer.resource_slice, node)]
        if not offers:
            return None
        generation = max(_get_generation(offer) for offer in offers)
        offers = sorted((offer for offer in offers if _get_generation(offer) == generation), key=_get_name)
        slice_count = offers[0].resource_slice.spec.pool.resource_slice_count
        driver, name = self.key
        if len(offers) != slice_count:
            generations = [_get_generation(offer) for offer in self.offers.values()]
            if max(generations) > generation:
                return None
            if generations.count(generation) != slice_count:
                return NodePool(driver, name, incomplete=True)
        offers = [offer for offer in offers if not offer.resource_slice.spec.shared_counters]
        names = [offered_device.id for offer in offers for offered_device in offer.devices]
        if len(set(names)) != len(names):
            return NodePool(driver, name, invalid=True)
        return NodePool(driver, name, tuple(offers))


class Inventory:
    """ResourceSlices and DeviceTaintRules as the watch has them, and the pools that follow from them."""

    def __init__(self) -> None:
        self._pools: dict[PoolKey, PoolSlices] = {}
        self._pool_of_slice: dict[str, PoolKey] = {}
        self._rules: dict[str, DeviceTaintRule] = {}
        self._pools_by_node: dict[str, set[PoolKey]] = {}
        """Pools with a slice that names the node."""
        self._shared_pools: set[PoolKey] = set()
        """Pools with a slice that selects nodes in another way than by name."""
        self._node_pools: dict[str, tuple[Mapping[str, str], tuple[NodePool, ...]]] = {}
        """Per node: its labels and the pools computed with them."""

    def __repr__(self) -> str:
        return f"Inventory({len(self._pools)} pools, {len(self._pool_of_slice)} slices, {len(self._rules)} rules)"

    def apply_slice(self, resource_slice: ResourceSlice) -> Collection[str] | None:
        """Adds or replaces a slice. Returns the names of nodes whose devices may have changed, None for any node."""
        name, spec = resource_slice.metadata.name, resource_slice.spec
        key = (spec.driver, spec.pool.name)
        node_names: Collection[str] | None = NONE_CONCERNED
        former_key = self._pool_of_slice.get(name)
        if former_key is not None:
            if self._pools[former_key].offers[name].resource_slice.spec == spec:
                return NONE_CONCERNED
            node_names = self._drop_slice(name, former_key)
        pool = self._pools.get(key)
        if pool is None:
            pool = self._pools[key] = PoolSlices(key)
        offer = pool.offers[name] = SliceOffer(resource_slice)
        offer.apply_taints(self._rules.values())
        self._pool_of_slice[name] = key
        self._index(pool)
        return self._forget(_join(node_names, pool.node_names()))

    def remove_slice(self, resource_slice: ResourceSlice) -> Collection[str] | None:
        """Removes a slice; result as for `apply_slice`."""
        name = resource_slice.metadata.name
        key = self._pool_of_slice.pop(name, None)
        return NONE_CONCERNED if key is None else self._forget(self._drop_slice(name, key))

    def apply_taint_rule(self, rule: DeviceTaintRule) -> Collection[str] | None:
        """Adds or replaces a rule; result as for `apply_slice`."""
        name = rule.metadata.name
        former_rule = self._rules.get(name)
        if former_rule is not None and former_rule.spec == rule.spec:
            return NONE_CONCERNED
        self._rules[name] = rule
        return self._apply_rules([rule] if former_rule is None else [former_rule, rule])

    def remove_taint_rule(self, rule: DeviceTaintRule) -> Collection[str] | None:
        """Removes a rule; result as for `apply_slice`."""
        former_rule = self._rules.pop(rule.metadata.name, None)
        return NONE_CONCERNED if former_rule is None else self._apply_rules([former_rule])

    def node_of(self, device: DeviceId) -> str:
        """The only node that can reach the device's pool, "" when there are several, or none is named."""
        pool = self._pools.get((device.driver, device.pool))
        names = pool.node_names() if pool is not None else None
        return next(iter(names)) if names is not None and len(names) == 1 else ""

    def pools_of(self, node: TargetNode) -> tuple[NodePool, ...]:
        """The pools that the node reaches in the order in which devices are tried.

        Pools with binding conditions come last, as in kube-scheduler, although no such device is allocated here.
        """
        entry = self._node_pools.get(node.name)
        if entry is not None and (entry[0] is node.labels or entry[0] == node.labels):
            return entry[1]
        keys = self._pools_by_node.get(node.name, set()) | self._shared_pools
        node_pools = [pool for key in sorted(keys) if (pool := self._pools[key].get_node_pool(node)) is not None]
        node_pools.sort(key=_has_binding_conditions)
        pools = tuple(node_pools)
        self._node_pools[node.name] = (node.labels, pools)
        return pools

    def forget_node(self, name: str) -> None:
        """Drops what was computed for a node that is gone."""
        self._node_pools.pop(name, None)

    def _drop_slice(self, name: str, key: PoolKey) -> Collection[str] | None:
        """Takes a slice out of its pool, and returns the nodes that reached the pool before."""
        pool = self._pools[key]
        node_names = pool.node_names()
        del pool.offers[name]
        for node_name in node_names or tuple(self._pools_by_node):
            self._pools_by_node.get(node_name, set()).discard(key)
        self._shared_pools.discard(key)
        if pool.offers:
            self._index(pool)
        else:
            del self._pools[key]
        for node_name in node_names or tuple(self._pools_by_node):
            if not self._pools_by_node.get(node_name, True):
                del self._pools_by_node[node_name]
        return node_names

    def _index(self, pool: PoolSlices) -> None:
        for offer in pool.offers.values():
            node_name = offer.resource_slice.spec.node_name
            if node_name:
                self._pools_by_node.setdefault(node_name, set()).add(pool.key)
            else:
                self._shared_pools.add(pool.key)

    def _apply_rules(self, rules: list[DeviceTaintRule]) -> Collection[str] | None:
        """Sets the taints of all pools that one of the rules selects."""
        node_names: Collection[str] | None = NONE_CONCERNED
        for pool in self._pools.values():
            if any(selects_pool(rule, *pool.key) for rule in rules):
                for offer in pool.offers.values():
                    offer.apply_taints(self._rules.values())
                node_names = _join(node_names, pool.node_names())
        return node_names

    def _forget(self, node_names: Collection[str] | None) -> Collection[str] | None:
        """Drops the computed pools of nodes whose devices may have changed."""
        if node_names is None:
            self._node_pools.clear()
        else:
            for node_name in node_names:
                self._node_pools.pop(node_name, None)
        return node_names


def reaches(resource_slice: ResourceSlice, node: TargetNode) -> bool:
    """Returns whether the slice offers a device to the node."""
    spec = resource_slice.spec
    if spec.per_device_node_selection:
        return any(reaches_from_device(device, node) for device in spec.devices)
    return _selects(node, spec.node_name, all_nodes=spec.all_nodes, node_selector=spec.node_selector)


def reaches_from_device(device: Device, node: TargetNode) -> bool:
    """Returns whether a device of a slice with perDeviceNodeSelection is offered to the node."""
    return _selects(node, device.node_name, all_nodes=device.all_nodes, node_selector=device.node_selector)


def _selects(node: TargetNode, node_name: str, *, all_nodes: bool, node_selector: NodeSelector | None) -> bool:
    if node_name:
        return node_name == node.name
    if all_nodes:
        return True
    return node_selector is not None and matches_node_terms(node_selector.node_selector_terms, node.labels, node.name)


def _get_generation(offer: SliceOffer) -> int:
    return offer.resource_slice.spec.pool.generation


def _get_name(offer: SliceOffer) -> str:
    return offer.name


def _has_binding_conditions(pool: NodePool) -> bool:
    return any(offer.has_binding_conditions for offer in pool.offers)


def _join(first: Collection[str] | None, second: Collection[str] | None) -> Collection[str] | None:
    """Both sets of node names; None stands for all nodes."""
    return None if first is None or second is None else {*first, *second}
