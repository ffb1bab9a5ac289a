"""Which volumes a pod's unbound claims would get on each node, and where they could be made.

One pass over all nodes: per claim an array says which candidate every node would use. Smaller claims choose first, and
the smallest volume that fits is chosen, as upstream does; among equal volumes the name decides.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from robotapp_api.values.selector import matches_labels
from robotapp_scheduler.core.api.storage_v1 import (
    AVAILABLE,
    NO_PROVISIONER,
    Claim,
    CSIStorageCapacity,
    PersistentVolume,
    StorageClass,
)
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray
from robotapp_scheduler.core.volumes.volume_cache import Volumes
from robotapp_scheduler.plugins.kubernetes.volumes.claims import Sorted
from robotapp_scheduler.plugins.kubernetes.volumes.node_reach import Reach, affinity_mask, selector_mask, topology_mask

PLUGIN: Final = "VolumeBinding"
REASONS: Final = (
    "node(s) didn't match PersistentVolume's node affinity",
    "node(s) didn't find available persistent volumes to bind",
    "node(s) did not have enough free storage",
    "node(s) unavailable due to one or more pvc(s) bound to non-existent pv(s)",
)
ELSEWHERE, NONE_FREE, NO_SPACE, NO_VOLUME = 1, 2, 4, 8
"""Bit per reason."""


class Given(NamedTuple):
    """An unbound claim and the volume it gets per node: index into `volumes`, -1 for none."""

    claim: Claim
    volumes: Sequence[PersistentVolume]
    chosen: IntArray


class Made(NamedTuple):
    """A claim whose volume must be made on some nodes: where, and out of which reported room (-1: none reported)."""

    claim: Claim
    where: BoolArray
    capacities: Sequence[CSIStorageCapacity]
    chosen: IntArray


class Match(NamedTuple):
    """Outcome for every node in view; `bits` are reasons against it, 0 where all claims can be satisfied."""

    bits: IntArray
    given: tuple[Given, ...]
    made: tuple[Made, ...]


def match(nodes: Snapshot, claims: Sorted, store: Volumes, reach: Reach) -> Match:
    """Judge every node in view. Raises PluginError when a claim's class has disappeared."""
    bits = _bound(nodes, claims.bound, store, reach)
    if not claims.delayed:
        return Match(bits, (), ())
    active = np.ones(nodes.n, dtype=np.bool_)
    selected: list[Claim] = []
    free: list[Claim] = []
    for claim in claims.delayed:
        node = store.selected_node(claim)
        if node is None:
            free.append(claim)
            continue
        selected.append(claim)
        active &= nodes.named((node,))
    bits[~active] |= NONE_FREE
    given = _give(nodes, sorted(free, key=lambda claim: claim.wants_bytes), store, reach)
    wanting = [(claim, active) for claim in selected] + [(g.claim, active & (g.chosen < 0)) for g in given]
    made = _make(nodes, wanting, store, bits)
    return Match(bits, given, made)


def _bound(nodes: Snapshot, claims: Sequence[Claim], store: Volumes, reach: Reach) -> IntArray:
    """The first bound claim that speaks against a node decides."""
    bits = np.zeros(nodes.n, dtype=np.int64)
    open_ = np.ones(nodes.n, dtype=np.bool_)
    for claim in claims:
        volume = store.volumes.get(claim.spec.volume_name)
        if volume is None:
            bits[open_] = NO_VOLUME
            break
        fits = within_reach(volume, nodes, store, reach)
        if fits is not None:
            bits[open_ & ~fits] = ELSEWHERE
            open_ &= fits
    return bits


def within_reach(volume: PersistentVolume, nodes: Snapshot, store: Volumes, reach: Reach) -> BoolArray | None:
    """Nodes that reach a bound volume, None for all; where its CSI driver attaches it, that driver's labels count."""
    plain = reach.mask(volume, nodes) if volume.affinity is not None else None
    kind = volume.in_tree
    there = store.taken_over.get(kind.plugin) if kind is not None else None
    if not there:
        return plain
    theirs = nodes.named(there)
    if not theirs.any():
        return plain
    try:
        affinity = volume.translated_affinity
    except ValueError as error:
        raise PluginError(PLUGIN, f"could not translate pv: {error}") from error
    if affinity is None:
        return plain
    return np.where(theirs, affinity_mask(nodes, affinity), True if plain is None else plain)


# --- Volumes that exist ------------------------------------------------------------------------------------------------


def _give(nodes: Snapshot, claims: Sequence[Claim], store: Volumes, reach: Reach) -> tuple[Given, ...]:
    used: dict[str, BoolArray] = {}
    """Volumes that smaller claims of the pod have taken, and where."""
    found: list[Given] = []
    for claim in claims:
        candidates = _candidates(claim, store)
        chosen = np.full(nodes.n, -1, dtype=np.int64)
        left = nodes.n
        for index, volume in enumerate(candidates):
            where = reach.positions(volume, nodes)
            where = where[chosen[where] < 0]
            taken = used.get(volume.metadata.name)
            if taken is not None:
                where = where[~taken[where]]
            if not len(where):
                continue
            chosen[where] = index
            if len(claims) > 1:
                used.setdefault(volume.metadata.name, np.zeros(nodes.n, dtype=np.bool_))[where] = True
            left -= len(where)
            if not left:
                break
        found.append(Given(claim, candidates, chosen))
    return tuple(found)


def _candidates(claim: Claim, store: Volumes) -> list[PersistentVolume]:
    """Volumes the claim may get, best first; one that was set aside for it rules out all others."""
    wants = claim.wants_bytes
    fitting = [
        volume
        for volume in store.by_class.get(claim.class_name, {}).values()
        if _may_hold(volume, claim, store) and store.sizes[volume.metadata.name] >= wants
    ]
    fitting.sort(key=lambda volume: (store.sizes[volume.metadata.name], volume.metadata.name))
    aside = [volume for volume in fitting if store.claim_ref(volume) is not None]
    return aside[:1] or [volume for volume in fitting if _free_for(volume, claim)]


def _may_hold(volume: PersistentVolume, claim: Claim, store: Volumes) -> bool:
    ref = store.claim_ref(volume)
    return (
        (ref is None or ref.means(claim))
        and volume.spec.volume_mode == claim.spec.volume_mode
        and (volume.spec.volume_attributes_class_name or "") == (claim.spec.volume_attributes_class_name or "")
        and volume.metadata.deletion_timestamp is None
    )


def _free_for(volume: PersistentVolume, claim: Claim) -> bool:
    return (
        volume.status.phase == AVAILABLE
        and set(claim.spec.access_modes) <= set(volume.spec.access_modes)
        and (claim.spec.selector is None or matches_labels(claim.spec.selector, volume.metadata.labels or {}))
    )


# --- Volumes to be made ------------------------------------------------------------------------------------------------


def _make(
    nodes: Snapshot, wanting: Sequence[tuple[Claim, BoolArray]], store: Volumes, bits: IntArray
) -> tuple[Made, ...]:
    """Per claim the nodes where its volume can be made; the first claim that cannot be made on a node decides there."""
    open_ = np.ones(nodes.n, dtype=np.bool_)
    made: list[Made] = []
    for claim, need in wanting:
        where = open_ & need
        if not where.any():
            continue
        storage_class = store.classes.get(claim.class_name)
        if storage_class is None:
            raise PluginError(PLUGIN, f'failed to find storage class "{claim.class_name}"')
        allowed = _provisionable(nodes, storage_class)
        bits[where & ~allowed] |= NONE_FREE
        where &= allowed
        capacities, chosen = _capacities(nodes, claim, storage_class, store)
        enough = chosen >= 0 if capacities is not None else np.ones(nodes.n, dtype=np.bool_)
        bits[where & ~enough] |= NO_SPACE
        where &= enough
        open_ &= where | ~need
        made.append(Made(claim, where, capacities or (), chosen))
    return tuple(made)


def _provisionable(nodes: Snapshot, storage_class: StorageClass) -> BoolArray:
    if storage_class.provisioner in {"", NO_PROVISIONER}:
        return np.zeros(nodes.n, dtype=np.bool_)
    return topology_mask(nodes, storage_class.allowed_topologies)


def _capacities(
    nodes: Snapshot, claim: Claim, storage_class: StorageClass, store: Volumes
) -> tuple[Sequence[CSIStorageCapacity] | None, IntArray]:
    """Per node the report of free room that suffices, -1 for none; no list when the driver does not report any."""
    chosen = np.full(nodes.n, -1, dtype=np.int64)
    driver = store.drivers.get(storage_class.provisioner)
    if not claim.has_size or driver is None or not driver.spec.storage_capacity:
        return None, chosen
    wants = claim.wants_bytes
    capacities = store.capacities_of(storage_class.metadata.name)
    for index, capacity in enumerate(capacities):
        limit = capacity.limit_bytes
        if limit is not None and limit >= wants:
            np.copyto(chosen, index, where=(chosen < 0) & selector_mask(nodes, capacity.node_topology))
    return capacities, chosen
