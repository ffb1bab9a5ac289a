"""The allocations of a pod's claims per node: computed once for all pods whose claims are equal, until the node's devices change."""

from collections import OrderedDict
from collections.abc import Hashable, Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_scheduler.core.dynamic_resources.allocator import Allocator
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError, NodeAllocationError
from robotapp_scheduler.core.dynamic_resources.inventory import TargetNode
from robotapp_scheduler.core.dynamic_resources.objects import AllocationResult, ResourceClaim

MOST_REMOVED: Final = 4096
"""Nodes that go before all results are dropped, which nobody else would ever do for those of nodes that are gone."""
MOST_CLASSES: Final = 32
"""Kinds of claims whose results are allocations."""


class NodeAllocation(NamedTuple):
    """The allocations on a node in the order of the claims; else `refusal`: why there are none there, or `error`: nowhere."""

    results: tuple[AllocationResult, ...] = ()
    refusal: str = ""
    error: str = ""


CANNOT_ALLOCATE: Final = "cannot allocate all claims"
_NONE: Final = NodeAllocation(refusal=CANNOT_ALLOCATE)


class NodeAllocations:
    """Results by what the claims request and by node. Dropped when another class was used longer ago than the limit."""

    def __init__(self) -> None:
        self._cache: ClaimCache | None = None
        self._removed_nodes = 0
        self._by_class: OrderedDict[Hashable, dict[str, tuple[Hashable, NodeAllocation]]] = OrderedDict()

    def __repr__(self) -> str:
        return f"NodeAllocations({len(self._by_class)} classes)"

    def get_allocations(
        self, cache: ClaimCache, key: Hashable, claims: Sequence[ResourceClaim], nodes: Mapping[str, Mapping[str, str]]
    ) -> dict[str, NodeAllocation]:
        """The allocations of claims with this key on nodes, whose labels are given by name."""
        is_outdated = cache.removed_nodes - self._removed_nodes > MOST_REMOVED
        if cache is not self._cache or is_outdated:  # another cluster is a simulation, or a test
            self._cache, self._removed_nodes = cache, cache.removed_nodes
            self._by_class.clear()
        allocations = self._by_class.setdefault(key, {})
        self._by_class.move_to_end(key)
        if len(self._by_class) > MOST_CLASSES:
            self._by_class.popitem(last=False)
        allocator = Allocator(cache.inventory, cache.classes, claims)
        result: dict[str, NodeAllocation] = {}
        for name, labels in nodes.items():
            revision = cache.get_revision(name)
            entry = allocations.get(name)
            if entry is None or entry[0] != revision:
                entry = allocations[name] = (revision, _allocate_on(allocator, TargetNode(name, labels), cache))
            result[name] = entry[1]
        return result


def allocate_on(
    cache: ClaimCache, claims: Sequence[ResourceClaim], name: str, labels: Mapping[str, str]
) -> NodeAllocation:
    """The allocations of these claims on one node, computed anew."""
    return _allocate_on(Allocator(cache.inventory, cache.classes, claims), TargetNode(name, labels), cache)


def _allocate_on(allocator: Allocator, node: TargetNode, cache: ClaimCache) -> NodeAllocation:
    try:
        results = allocator.allocate(node, cache.allocated)
    except NodeAllocationError as error:
        return NodeAllocation(refusal=str(error))
    except AllocationError as error:
        return NodeAllocation(error=str(error))
    return NodeAllocation(results) if results is not None else _NONE
