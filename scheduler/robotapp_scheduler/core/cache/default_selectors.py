"""Default selectors of pods: those of their Services and of the workload that owns them."""

from typing import Any, Final

from robotapp_api.values.selector import Expression, label_requirements, matches_requirements
from robotapp_scheduler.core.api.core_v1 import Selecting
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.selectors.pod_matcher import ByLabel, Requirements

SERVICE: Final = "Service"
REPLICATION_CONTROLLER: Final = "ReplicationController"
OWNERS: Final = {
    ("v1", REPLICATION_CONTROLLER): REPLICATION_CONTROLLER,
    ("apps/v1", "ReplicaSet"): "ReplicaSet",
    ("apps/v1", "StatefulSet"): "StatefulSet",
}
"""apiVersion and kind of the controllers whose selector counts."""
MOST_MERGED: Final = 8192


class _Service:
    """A Service with a selector."""

    __slots__ = ("labels", "requirements")

    def __init__(self, labels: dict[str, str]) -> None:
        self.labels = labels
        self.requirements: Requirements = label_requirements({"matchLabels": labels}) or ()


class DefaultSelectors:
    """Selectors of Services and workloads; results are kept until one of them changes."""

    __slots__ = ("_by_label", "_merged_selectors", "_selectors", "_services")

    def __init__(self) -> None:
        self._selectors: dict[tuple[str, str, str], dict[str, Any] | None] = {}
        self._services: dict[tuple[str, str], _Service] = {}
        self._by_label: dict[str, ByLabel[_Service]] = {}
        self._merged_selectors: dict[tuple[object, ...], Requirements] = {}

    def __repr__(self) -> str:
        return f"DefaultSelectors({len(self._services)} services, {len(self._selectors)} workloads)"

    def apply(self, kind: str, found: Selecting) -> bool:
        """Take in a Service or workload; True when its selector is new."""
        key = (kind, found.metadata.namespace, found.metadata.name)
        if key in self._selectors and self._selectors[key] == found.spec.selector:
            return False
        self._forget_service(*key)
        self._selectors[key] = found.spec.selector
        if kind == SERVICE and found.spec.selector is not None:
            service = self._services[key[1:]] = _Service(found.spec.selector)
            self._by_label.setdefault(key[1], ByLabel()).add(service, service.requirements)
        self._merged_selectors.clear()
        return True

    def remove(self, kind: str, found: Selecting) -> bool:
        """Forget a Service or workload."""
        key = (kind, found.metadata.namespace, found.metadata.name)
        if key not in self._selectors:
            return False
        del self._selectors[key]
        self._forget_service(*key)
        self._merged_selectors.clear()
        return True

    def of(self, pod: PodInfo) -> Requirements:
        """The expressions of all selectors that stand for the pod; () when there are none."""
        key = pod.features(("controller", "labels", "namespace"))
        merged = self._merged_selectors.get(key)
        if merged is None:
            if len(self._merged_selectors) >= MOST_MERGED:
                self._merged_selectors.clear()
            merged = self._merged_selectors[key] = self._merged(pod)
        return merged

    def _merged(self, pod: PodInfo) -> Requirements:
        labels: dict[str, str] = {}
        services = self._by_label.get(pod.namespace)
        if services is not None:
            for service in services.candidates(pod.labels):
                if matches_requirements(service.requirements, pod.labels):
                    labels |= service.labels
        owner = pod.controller
        kind = OWNERS.get((owner.api_version, owner.kind)) if owner is not None else None
        selector = self._selectors.get((kind, pod.namespace, owner.name)) if owner is not None and kind else None
        if kind == REPLICATION_CONTROLLER:
            labels |= selector or {}
            selector = None
        found = {Expression(key, "In", (value,)) for key, value in labels.items()}
        return tuple(sorted(found | set(label_requirements(selector) or ())))

    def _forget_service(self, kind: str, namespace: str, name: str) -> None:
        if kind == SERVICE and (old := self._services.pop((namespace, name), None)) is not None:
            self._by_label[namespace].remove(old, old.requirements)
