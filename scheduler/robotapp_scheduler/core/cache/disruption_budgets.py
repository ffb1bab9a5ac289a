"""PodDisruptionBudgets: which victims of a preemption would break one."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec

from robotapp_api.values.selector import matches_labels
from robotapp_scheduler.core.api.core_v1 import Metadata
from robotapp_scheduler.core.api.structs import Slim
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PlacedPod


class BudgetSpec(Slim):
    """spec of a PodDisruptionBudget."""

    selector: dict[str, Any] | None = None


class BudgetStatus(Slim):
    """status of a PodDisruptionBudget; `disrupted_pods` are already counted by the API server."""

    disruptions_allowed: int = 0
    disrupted_pods: dict[str, Any] | None = None


class DisruptionBudget(Slim):
    """How many pods of a namespace may be disrupted at a time."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: BudgetSpec = msgspec.field(default_factory=BudgetSpec)
    status: BudgetStatus = msgspec.field(default_factory=BudgetStatus)


class Split(NamedTuple):
    """Pods by whether evicting them would break a budget, each part in the order given."""

    violating: tuple[PlacedPod, ...]
    others: tuple[PlacedPod, ...]


class Budgets:
    """All PodDisruptionBudgets of the cluster."""

    def __init__(self) -> None:
        self._by_namespace: dict[str, dict[str, DisruptionBudget]] = {}
        self.generation = 0
        """Grows with every change."""

    def __repr__(self) -> str:
        return f"Budgets({sum(map(len, self._by_namespace.values()))})"

    def apply(self, budget: DisruptionBudget) -> Change:
        """A budget appeared or changed; no waiting pod can profit at once."""
        self._by_namespace.setdefault(budget.metadata.namespace, {})[budget.metadata.name] = budget
        self.generation += 1
        return Change.NONE

    def remove(self, budget: DisruptionBudget) -> Change:
        """A budget is gone."""
        of_namespace = self._by_namespace.get(budget.metadata.namespace, {})
        of_namespace.pop(budget.metadata.name, None)
        if not of_namespace:
            self._by_namespace.pop(budget.metadata.namespace, None)
        self.generation += 1
        return Change.NONE

    def split(self, pods: Sequence[PlacedPod]) -> Split:
        """Remove the pods in this order: those of which some budget allows no more disruptions violate it."""
        if not self._by_namespace:
            return Split((), tuple(pods))
        left: dict[tuple[str, str], int] = {}
        violating = [self._violates(pod, left) for pod in pods]
        return Split(
            tuple(pod for pod, bad in zip(pods, violating, strict=True) if bad),
            tuple(pod for pod, bad in zip(pods, violating, strict=True) if not bad),
        )

    def _violates(self, pod: PlacedPod, left: dict[tuple[str, str], int]) -> bool:
        for name, budget in self._by_namespace.get(pod.namespace, {}).items():
            # An empty selector stands for every pod of the namespace, as the eviction API reads it.
            if not matches_labels(budget.spec.selector, pod.labels) or pod.name in (budget.status.disrupted_pods or {}):
                continue
            key = (pod.namespace, name)
            left[key] = left.get(key, budget.status.disruptions_allowed) - 1
            if left[key] < 0:
                return True
        return False
