"""Labels the API server copies from a node to each pod bound to it, where the pod has none of that name: zone and region.

It does so since 1.33 (PodTopologyLabelsAdmission) unless that is off. Who counts a pod without them before its bind is confirmed
has to take it off its node and put it on again, which is dearer than the decision was.
"""

from typing import Final

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.topology_labels import REGION, ZONE
from robotapp_scheduler.core.nodes.columns import LabelColumns

KEYS: Final = (ZONE, REGION)
Stamp = tuple[tuple[str, str], ...]


class Stamps:
    """Foretells them once a confirmed bind has shown that this API server does so; a wrong guess costs time, nothing else."""

    def __init__(self, labels: LabelColumns) -> None:
        """`labels` are those of the nodes."""
        self._labels = labels
        self._seen = False

    def __repr__(self) -> str:
        return f"Stamps({'seen' if self._seen else 'not seen'})"

    def of(self, row: int | None) -> Stamp:
        """Labels (name, value) a pod is about to get from the node of this row."""
        return self._on(row) if self._seen and row is not None else ()

    def learn(self, row: int | None, bound: Pod) -> None:
        """A pod bound by us, as the API server shows it now."""
        expected = self._on(row) if row is not None else ()
        if expected:
            labels = bound.metadata.labels or {}
            self._seen = all(labels.get(key) == value for key, value in expected)

    def _on(self, row: int) -> Stamp:
        labels = self._labels.of(row)
        return tuple([(key, labels[key]) for key in KEYS if key in labels])  # for every pod: no generator
