"""One pod against one state of the cluster: what every rule is given."""

from collections.abc import Callable, Iterable
from typing import Any

from campaigns.reference_scheduler.labels import Labels, labels_of
from campaigns.reference_scheduler.model import ClusterDump, Config, Json

ENDED = ("Succeeded", "Failed")


def name_of(item: Json) -> str:
    return str(item["metadata"]["name"])


def namespace_of(item: Json) -> str:
    return str(item["metadata"].get("namespace") or "default")


def identity(pod: Json) -> str:
    return str(pod["metadata"].get("uid") or f"{namespace_of(pod)}/{name_of(pod)}")


def priority_of(pod: Json) -> int:
    return int(pod["spec"].get("priority") or 0)


def terminating(pod: Json) -> bool:
    return bool(pod["metadata"].get("deletionTimestamp"))


class State:
    """The pod to place, the nodes, and who sits where.

    `placed` may differ from `at_start` (what PreFilter saw) on one node: pods taken away or added for a trial.
    """

    def __init__(
        self, *, pod: Json, cluster: ClusterDump, config: Config, placed: dict[str, list[Json]],
        at_start: dict[str, list[Json]],
    ) -> None:  # fmt: skip
        self.pod = pod
        self.cluster = cluster
        self.config = config
        self.placed = placed
        self.at_start = at_start
        self._memo: dict[str, Any] = {}

    @classmethod
    def of(cls, cluster: ClusterDump, pod: Json, config: Config) -> "State":
        """Pods that have ended hold nothing; those on nodes that do not exist are not seen."""
        placed: dict[str, list[Json]] = {name_of(node): [] for node in cluster.nodes}
        for other in cluster.pods:
            node = other["spec"].get("nodeName")
            if node in placed and (other.get("status") or {}).get("phase") not in ENDED:
                placed[node].append(other)
        return cls(pod=pod, cluster=cluster, config=config, placed=placed, at_start=placed)

    @property
    def nodes(self) -> list[Json]:
        return self.cluster.nodes

    def on(self, node: Json) -> list[Json]:
        return self.placed[name_of(node)]

    def everyone(self) -> Iterable[tuple[Json, Json]]:
        """(pod, its node) for every placed pod."""
        for node in self.nodes:
            for other in self.on(node):
                yield other, node

    def with_pods(self, node: Json, pods: list[Json]) -> "State":
        """The same moment with other pods on one node."""
        return State(
            pod=self.pod,
            cluster=self.cluster,
            config=self.config,
            placed={**self.placed, name_of(node): pods},
            at_start=self.at_start,
        )

    def once(self, key: str, make: Callable[["State"], Any]) -> Any:
        """`make(self)`, computed once for this state."""
        if key not in self._memo:
            self._memo[key] = make(self)
        return self._memo[key]

    def namespace_labels(self, namespace: str) -> Labels:
        for each in self.cluster.namespaces:
            if name_of(each) == namespace:
                return labels_of(each)
        return {}
