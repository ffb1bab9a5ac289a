"""Records of placed pods: computed once per pod signature, copied for each replica.

`PredictedLabels` predicts the zone and region labels that the API server copies from a node to each pod bound to it, where the pod
has none of that name. It does so since 1.33 (PodTopologyLabelsAdmission) unless that is off. Without the prediction each
confirmed bind takes the pod off its node and puts it on again, which costs more than the decision did.
"""

from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.topology_labels import REGION, ZONE
from robotapp_scheduler.core.nodes.columns import LabelColumns, ResourceColumns, sane
from robotapp_scheduler.core.pods.interning import Interner
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo

KEYS: Final = (ZONE, REGION)
Stamp = tuple[tuple[str, str], ...]


class PredictedLabels:
    """Foretells them once a confirmed bind has shown that this API server does so; a wrong guess costs time, nothing else."""

    def __init__(self, labels: LabelColumns) -> None:
        """`labels` are those of the nodes."""
        self._labels = labels
        self._seen = False

    def __repr__(self) -> str:
        return f"PredictedLabels({'seen' if self._seen else 'not seen'})"

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


class Records:
    """Makes the record of a pod on a node."""

    def __init__(
        self,
        resources: ResourceColumns,
        alike: Interner,
        *,
        like: Callable[[str, dict[str, str]], dict[str, str] | None],
    ) -> None:
        """`like` finds the labels that placed pods with equal ones in a namespace share."""
        self._resources = resources
        self._alike = alike
        self._like = like

    def __repr__(self) -> str:
        return f"Records({self._resources!r})"

    def of(self, info: PodInfo, node: str, *, assumed: bool, stamp: Stamp = ()) -> PlacedPod:
        """What this pod holds on a node, with the labels it will have there. Raises ValueError when a quantity cannot be read."""
        shape = info.shape
        key = (self, stamp)
        blank: PlacedPod | None = shape.notes.get(key)
        if blank is None:
            blank = self._blank(info, stamp)
            shared = self._like(blank.namespace, blank.labels)
            if shared is not None and self._resources in shape.notes:  # it has its like, and what it holds is settled
                blank.labels = shared
                shape.notes[key] = blank
        return replace(
            blank, uid=info.uid, name=info.name, node=node, terminating=info.deleting, assumed=assumed, pod=info.pod
        )

    def _blank(self, info: PodInfo, stamp: Stamp) -> PlacedPod:
        """The record of any pod of this shape: all it says but uid, name, node and state follows from the shape."""
        requests = info.requests
        return PlacedPod(
            uid="",
            name="",
            namespace=info.namespace,
            node="",
            labels=dict(stamp) | info.labels if stamp else info.labels,
            priority=info.priority,
            requested=self._alike.same(info.shape.held(self._resources)),
            scored_cpu_milli=sane(requests.placed.get("cpu", 0)),
            scored_memory_bytes=sane(requests.placed.get("memory", 0)),
            ports=info.host_ports,
            terminating=False,
            assumed=False,
            member=info.member,
            volumes=info.volumes,
            pod=info.pod,
            affinity=self._alike.same(info.affinity_key),
            shape=info.shape.number,
        )
