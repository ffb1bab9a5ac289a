"""The allocations of a pod's claims per node: computed once for all pods whose claims are equal, until the node's devices change.

Each node is searched with the few steps of its own first. Those that need more share what the attempt may spend beyond that,
so one attempt takes some milliseconds at most, whatever the claims are.
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from robotapp_scheduler.core.dynamic_resources.allocator import (
    MOST_STEPS,
    SEARCH_ENDED,
    Allocator,
    SearchTooLongError,
)
from robotapp_scheduler.core.dynamic_resources.claim_cache import ClaimCache
from robotapp_scheduler.core.dynamic_resources.errors import AllocationError, NodeAllocationError
from robotapp_scheduler.core.dynamic_resources.inventory import TargetNode
from robotapp_scheduler.core.dynamic_resources.objects import AllocationResult, ResourceClaim

MOST_REMOVED: Final = 4096
"""Nodes that go before all results are dropped, which nobody else would ever do for those of nodes that are gone."""
MOST_CLASSES: Final = 32
"""Kinds of claims whose results are allocations."""
LEAST_SHARE: Final = 250
"""Steps that are worth a second search of a node; nodes for which none are left are not searched again."""


class NodeAllocation(NamedTuple):
    """The allocations on a node in the order of the claims; else `refusal`: why there are none there, or `error`: nowhere."""

    results: tuple[AllocationResult, ...] = ()
    refusal: str = ""
    error: str = ""


CANNOT_ALLOCATE: Final = "cannot allocate all claims"
_NONE: Final = NodeAllocation(refusal=CANNOT_ALLOCATE)
_UNDECIDED: Final = NodeAllocation(refusal=SEARCH_ENDED)


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
        revisions = {name: cache.get_revision(name) for name in nodes}
        outdated_nodes = [
            TargetNode(name, labels)
            for name, labels in nodes.items()
            if name not in allocations or allocations[name][0] != revisions[name]
        ]
        for name, allocation in _allocate_on_nodes(cache, claims, outdated_nodes):
            allocations[name] = (revisions[name], allocation)
        return {name: allocations[name][1] for name in nodes}


def allocate_on(
    cache: ClaimCache, claims: Sequence[ResourceClaim], name: str, labels: Mapping[str, str]
) -> NodeAllocation:
    """The allocations of these claims on one node, computed anew."""
    return dict(_allocate_on_nodes(cache, claims, [TargetNode(name, labels)]))[name]


def _allocate_on_nodes(
    cache: ClaimCache, claims: Sequence[ResourceClaim], nodes: Sequence[TargetNode]
) -> Iterator[tuple[str, NodeAllocation]]:
    allocator = Allocator(cache.inventory, cache.classes, claims)
    undecided_nodes: list[TargetNode] = []
    for node in nodes:
        allocation = _allocate_on(allocator, node, cache, extra_steps=0)
        if allocation is _UNDECIDED:
            undecided_nodes.append(node)
        else:
            yield node.name, allocation
    share = max(LEAST_SHARE, MOST_STEPS // max(1, len(undecided_nodes)))
    for position, node in enumerate(undecided_nodes, start=1):
        is_affordable = position * share <= MOST_STEPS
        yield node.name, _allocate_on(allocator, node, cache, extra_steps=share) if is_affordable else _UNDECIDED


def _allocate_on(allocator: Allocator, node: TargetNode, cache: ClaimCache, *, extra_steps: int) -> NodeAllocation:
    try:
        results = allocator.allocate(node, cache.allocated, extra_steps)
    except SearchTooLongError:
        return _UNDECIDED
    except NodeAllocationError as error:
        return NodeAllocation(refusal=str(error))
    except AllocationError as error:
        return NodeAllocation(error=str(error))
    return NodeAllocation(results) if results is not None else _NONE
