"""What pods hold once they are placed: worked out once per shape, copied for each replica."""

from collections.abc import Callable

from msgspec.structs import replace

from robotapp_scheduler.core.nodes.columns import ResourceColumns, sane
from robotapp_scheduler.core.pods.interning import Alike
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.stamps import Stamp


class Records:
    """Makes the record of a pod on a node."""

    def __init__(
        self,
        resources: ResourceColumns,
        alike: Alike,
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
