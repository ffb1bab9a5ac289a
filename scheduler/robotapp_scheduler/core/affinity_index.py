"""Placed pods with required anti-affinity: each keeps pods it does not want out of its topology domain."""

from collections.abc import Iterator
from typing import NamedTuple

from robotapp_api.values.selector import matches_labels
from robotapp_scheduler.core.objects import PodAffinityTerm
from robotapp_scheduler.core.pods import PlacedPod, PodInfo


class Ward(NamedTuple):
    """One term of one placed pod that keeps the asking pod away."""

    node: str
    topology_key: str


class AntiAffinityIndex:
    """The few placed pods that have required anti-affinity terms."""

    def __init__(self) -> None:
        self._pods: dict[str, PlacedPod] = {}

    def __repr__(self) -> str:
        return f"AntiAffinityIndex({len(self._pods)} pods)"

    def count(self, record: PlacedPod, sign: int) -> bool:
        """Take a placed pod in (+1) or out (-1); True when it has such terms."""
        if record.pod.spec.affinity is None or not _terms(record):
            return False
        if sign > 0:
            self._pods[record.uid] = record
        else:
            self._pods.pop(record.uid, None)
        return True

    def wards(self, pod: PodInfo) -> Iterator[Ward]:
        """Terms of placed pods that match this pod. A namespace selector counts as matching every namespace."""
        for record in self._pods.values():
            for term in _terms(record):
                if _namespace_matches(term, record.namespace, pod.namespace) and matches_labels(
                    term.label_selector, pod.labels
                ):
                    yield Ward(record.node, term.topology_key)

    def __len__(self) -> int:
        return len(self._pods)


def _terms(record: PlacedPod) -> tuple[PodAffinityTerm, ...]:
    affinity = record.pod.spec.affinity
    anti = affinity.pod_anti_affinity if affinity else None
    return anti.required if anti else ()


def _namespace_matches(term: PodAffinityTerm, own: str, asking: str) -> bool:
    if term.namespace_selector is not None:
        # Namespace labels are not watched yet: taking the strict side never places a pod where it must not be.
        return True
    return asking in term.namespaces if term.namespaces else asking == own
