"""Everything a cache holds as plain values, so that two moments can be compared: rows, indexes, counts and the change log."""

from collections import OrderedDict
from collections.abc import Mapping
from types import FunctionType, MethodType
from typing import Any, Final

import msgspec
import numpy as np
from tests.support.scheduling import Json

from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.selectors.label_sets import label_key
from robotapp_scheduler.core.selectors.pod_counts import Counter

LEFT_OUT: Final = {
    "NodeTable.versions": "only grow: what was read during the moves must never pass for what is so now",
    "Volumes.revision": "likewise",
    "NodeTable.rows": "a memo by these versions",
    "Cache.resource_arrays": "follows the ledger from the change log (tests/property/core/memory/test_mirror_stays_true.py)",
    "Cache.minimum_free": "likewise",
    "Cache.amount_codes": "likewise",
    "Cache.by_priority": "compared below as it is read",
    "Cache._interner": "shares equal parts of objects",
    "Cache._signatures": "shares what replicas have in common",
    "Cache._records": "shares equal parts of records",
    "Cache._clock": "is passed in",
    "Topology._compiler": "a memo of terms by their text",
    "Topology._single": "a memo by versions of labels",
    "Topology._wide_before": "has a meaning during a dry run only",
    "Topology.scopes": "a memo of node selections",
    "LabelSets._by_dict": "finds a label set by the identity of its labels",
    "LabelSets._by_label": "a memo of label keys that a selector has named",
    "LabelSets._latest": "the label set that was used last",
    "LabelSet.counters": "follows from labels and counters, whose columns are compared",
    "PodCounts._by_label": "finds counters by labels",
    "PodCounts._rows": "how many rows the columns have",
    "Counter._domains": "sums of the column, compared below as they are read",
    "AffinityIndex._by_label": "finds terms by labels",
    "AffinityIndex._recent": "a memo of which terms are new",
    "AffinityIndex._before": "likewise",
    "AffinityIndex._pulls": "a memo, compared below as it is read",
    "AffinityIndex._totals": "likewise",
    "PlacedTerm.listeners": "belongs to these",
    "ResourceColumns._places": "a memo of positions",
    "ResourceColumns._spans": "likewise",
    "ResourceColumns._steps": "a memo of what pods add",
    "LabelColumns._columns": "labels of nodes, made when a rule first reads them",
    "LabelColumns._versions": "likewise",
    "FactColumns._columns": "facts of plugins about nodes, made when a rule first reads them",
    "DefaultSelectors._merged_selectors": "a memo of Services by labels",
    "VolumeUsers._uses": "a memo of volumes in use, compared below as it is read",
}
"""Attributes that may differ, each with the reason."""
IN_ORDER: Final = frozenset({"Nominator._by_uid"})
"""Mappings whose order decides something."""
PRIORITIES: Final = (*range(-1, 8), 2**31)


def dump(cache: Cache) -> dict[str, Any]:
    """The cache by value. Objects of the API are compared as the same objects."""
    counters = {wanted: counter for wanted, counter in cache.topology.counts._counters.items() if counter.column.any()}
    found = _plain(cache, "")
    del found["topology"]["counts"]["_counters"]
    return {
        **found,
        "counters": {str(wanted): _counted(counter) for wanted, counter in counters.items()},
        "terms of others": {str(key): _pull(cache, key) for key in _label_keys(cache)},
        "volumes in use": {name: cache.volumes.users.on(name) for name in cache.nodes.row_of},
        "held below": {str(priority): _filled(cache.held_below(priority)) for priority in PRIORITIES},
    }


def differences(before: Any, after: Any, path: str = "") -> list[str]:
    """Where two dumps differ. Counters and sums that only one has are left out: they are made when first read."""
    if isinstance(before, dict) and isinstance(after, dict):
        keys = before.keys() & after.keys() if path.startswith(".counters") else before.keys() | after.keys()
        return [
            line
            for key in sorted(keys, key=str)
            for line in differences(before.get(key), after.get(key), f"{path}.{key}")
        ]
    return [] if before is after or before == after else [f"{path}: {before!r} became {after!r}"]


def _counted(counter: Counter) -> Json:
    domains = {
        str(key): np.trim_zeros(found.values.tolist(), "b")
        for key, found in counter._domains.items()
        if not found.stale
    }
    return {"rows": _filled(counter.column), **domains}


def _label_keys(cache: Cache) -> set[Any]:
    pods = [record.pod for record in cache.placed.values()] + list(cache._seen.values())
    return {label_key(pod.metadata.namespace, pod.metadata.labels or {}) for pod in pods}


def _pull(cache: Cache, key: Any) -> Json:
    pull = cache.topology.affinity.pull(key)
    return {
        f"{kind} {totals.key}": np.trim_zeros(totals.values.tolist(), "b")
        for kind, found in pull.by_kind.items()
        for totals in found
        if totals.values.any()
    }


def _plain(value: Any, path: str) -> Any:
    if isinstance(value, np.ndarray):
        return _filled(value)
    if isinstance(value, PlacedPod):
        return _record(value, placed=path == "Cache.placed")
    if path == "Cache._by_node":  # their order on a node decides among equals; the records are compared by uid
        return {node: list(pods) for node, pods in value.items()}
    if isinstance(value, OrderedDict | dict | Mapping):
        items = [(key if isinstance(key, str | int) else str(key), _plain(each, path)) for key, each in value.items()]
        return tuple(items) if path in IN_ORDER else dict(items)
    if isinstance(value, list | tuple):
        return [_plain(each, path) for each in value]
    if isinstance(value, msgspec.Struct | PodInfo | FunctionType | MethodType) or not type(value).__module__.startswith(
        "robotapp_"
    ):
        return value
    names = vars(value) if hasattr(value, "__dict__") else ()
    slots = [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())]
    found = {}
    for name in (*names, *slots):
        attribute = f"{type(value).__name__}.{name}"
        if attribute not in LEFT_OUT and hasattr(value, name) and not _refers_back(attribute):
            found[name] = _plain(getattr(value, name), attribute)
    return found


def _filled(array: Any) -> Json:
    """The elements that are not 0: columns grow, which changes nothing."""
    return {str(tuple(map(int, at))): array[tuple(at)].item() for at in np.argwhere(array)}


def _record(record: PlacedPod, *, placed: bool) -> Json:
    """Label set and terms have a meaning while the pod is placed only."""
    label_set = record.label_set if placed else None
    found = {
        name: getattr(record, name) for name in record.__struct_fields__ if name not in {"label_set", "terms", "labels"}
    }
    terms = [placed_term.term for placed_term in record.terms] if placed else []
    return {**found, "labels": dict(record.labels), "label set": label_set and dict(label_set.labels), "terms": terms}


def _refers_back(attribute: str) -> bool:
    """Does it refer to another part of the cache, which is dumped there?"""
    return attribute in {"Topology._nodes", "PodCounts._label_sets", "AffinityIndex._namespaces"} or attribute.endswith(
        ("._labels", "._table", "._resources")
    )
