"""Labels of namespaces: terms of pod affinity may select namespaces by them."""

from collections.abc import Mapping
from typing import Final

from robotapp_api.values.selector import matches_requirements
from robotapp_scheduler.core.api.core_v1 import Namespace
from robotapp_scheduler.core.selectors.pod_matcher import Requirements

NO_LABELS: Final[Mapping[str, str]] = {}


class Namespaces:
    """Known namespaces; `generation` grows when one comes, goes or changes labels."""

    __slots__ = ("_labels", "_matching", "generation")

    def __init__(self) -> None:
        self._labels: dict[str, Mapping[str, str]] = {}
        self._matching: dict[Requirements, frozenset[str]] = {}
        self.generation = 0

    def __repr__(self) -> str:
        return f"Namespaces({len(self._labels)})"

    def apply(self, namespace: Namespace) -> bool:
        """Take in a namespace; True when that changes anything."""
        labels = namespace.metadata.labels or NO_LABELS
        if self._labels.get(namespace.metadata.name) == labels:
            return False
        self._labels[namespace.metadata.name] = labels
        self._changed()
        return True

    def remove(self, name: str) -> bool:
        """Forget a namespace; True when it was known."""
        if self._labels.pop(name, None) is None:
            return False
        self._changed()
        return True

    def labels_of(self, name: str) -> Mapping[str, str]:
        """Labels of a namespace, none when it is not known."""
        return self._labels.get(name, NO_LABELS)

    def matching(self, requirements: Requirements) -> frozenset[str]:
        """Names of the known namespaces that meet these expressions."""
        found = self._matching.get(requirements)
        if found is None:
            names = (name for name, labels in self._labels.items() if matches_requirements(requirements, labels))
            found = self._matching[requirements] = frozenset(names)
        return found

    def _changed(self) -> None:
        self._matching.clear()
        self.generation += 1
