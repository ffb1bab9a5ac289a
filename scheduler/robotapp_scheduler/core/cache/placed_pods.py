"""Placed pods: their records, their names (`NameIndex`), what those below a priority hold (`PriorityColumns`), and their host ports.

A record is computed once per pod signature and copied for each replica.

`PredictedLabels` predicts the zone and region labels that the API server copies from a node to each pod bound to it, where the pod
has none of that name. It does so since 1.33 (PodTopologyLabelsAdmission) unless that is off. Without the prediction each
confirmed bind takes the pod off its node and puts it on again, which costs more than the decision did.
"""

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from msgspec.structs import replace

from robotapp_scheduler.core.api.core_v1 import REGION, ZONE, Pod, controller_of
from robotapp_scheduler.core.nodes.columns import BoolArray, IntArray, LabelColumns, ResourceColumns, sane
from robotapp_scheduler.core.nodes.node_table import NodeTable
from robotapp_scheduler.core.pods.interning import Interner
from robotapp_scheduler.core.pods.pod_info import PlacedPod, PodInfo
from robotapp_scheduler.core.pods.pod_signature import ANY_IP, HostPort

KEYS: Final = (ZONE, REGION)
PredictedPairs = tuple[tuple[str, str], ...]


class PredictedLabels:
    """Predicts these labels once a confirmed bind has shown that this API server copies them; a wrong prediction costs time only."""

    def __init__(self, labels: LabelColumns) -> None:
        """`labels` are those of the nodes."""
        self._labels = labels
        self._seen = False

    def __repr__(self) -> str:
        return f"PredictedLabels({'seen' if self._seen else 'not seen'})"

    def of(self, row: int | None) -> PredictedPairs:
        """Labels (name, value) a pod is about to get from the node of this row."""
        return self._on(row) if self._seen and row is not None else ()

    def learn(self, row: int | None, bound: Pod) -> None:
        """Compare the prediction with a pod that this scheduler bound, as the API server shows it now."""
        expected = self._on(row) if row is not None else ()
        if expected:
            labels = bound.metadata.labels or {}
            self._seen = all(labels.get(key) == value for key, value in expected)

    def _on(self, row: int) -> PredictedPairs:
        labels = self._labels.of(row)
        return tuple([(key, labels[key]) for key in KEYS if key in labels])  # for every pod: no generator


class Records:
    """Makes the record of a pod on a node."""

    def __init__(
        self,
        resources: ResourceColumns,
        interner: Interner,
        *,
        like: Callable[[str, dict[str, str]], dict[str, str] | None],
    ) -> None:
        """`like` finds the labels that placed pods with equal ones in a namespace share."""
        self._resources = resources
        self._interner = interner
        self._like = like

    def __repr__(self) -> str:
        return f"Records({self._resources!r})"

    def of(self, info: PodInfo, node: str, *, assumed: bool, predicted: PredictedPairs = ()) -> PlacedPod:
        """What this pod holds on a node, with the labels it will have there. Raises ValueError when a quantity cannot be read."""
        signature = info.signature
        key = (self, predicted)
        blank: PlacedPod | None = signature.notes.get(key)
        if blank is None:
            blank = self._blank(info, predicted)
            shared = self._like(blank.namespace, blank.labels)
            if (
                shared is not None and self._resources in signature.notes
            ):  # it has its like, and what it holds is settled
                blank.labels = shared
                signature.notes[key] = blank
        return replace(
            blank, uid=info.uid, name=info.name, node=node, terminating=info.deleting, assumed=assumed, pod=info.pod
        )

    def _blank(self, info: PodInfo, predicted: PredictedPairs) -> PlacedPod:
        """The record of any pod of this signature: all but uid, name, node and state follows from the signature."""
        requests = info.requests
        return PlacedPod(
            uid="",
            name="",
            namespace=info.namespace,
            node="",
            labels=dict(predicted) | info.labels if predicted else info.labels,
            priority=info.priority,
            requested=self._interner.same(info.signature.held(self._resources)),
            scored_cpu_milli=sane(requests.placed.get("cpu", 0)),
            scored_memory_bytes=sane(requests.placed.get("memory", 0)),
            ports=info.host_ports,
            terminating=False,
            assumed=False,
            member=info.member,
            volumes=info.volumes,
            pod=info.pod,
            affinity=self._interner.same(info.affinity_key),
            signature=info.signature.number,
        )


class NameIndex:
    """Finds placed pods by the names that users write: a pod's or a Deployment's."""

    def __init__(self) -> None:
        self._by_name: dict[tuple[str, str], str] = {}
        """Uid of the placed pod of this namespace and name: one string per pod, tens of thousands of times."""
        self._by_deployment: dict[tuple[str, str], dict[str, None]] = {}

    def __repr__(self) -> str:
        return f"NameIndex({len(self._by_name)} pods, {len(self._by_deployment)} Deployments)"

    def add(self, record: PlacedPod) -> None:
        """A pod was placed."""
        self._by_name[record.namespace, record.name] = record.uid
        if deployment := _deployment_of(record.pod):
            self._by_deployment.setdefault((record.namespace, deployment), {})[record.uid] = None

    def remove(self, record: PlacedPod) -> None:
        """A placed pod is gone."""
        key = (record.namespace, record.name)
        if self._by_name.get(key) == record.uid:
            del self._by_name[key]
        deployment = _deployment_of(record.pod)
        uids = self._by_deployment.get((record.namespace, deployment)) if deployment else None
        if uids is not None:
            uids.pop(record.uid, None)
            if not uids:
                del self._by_deployment[record.namespace, deployment]

    def uids(self, namespace: str, name: str) -> list[str]:
        """Uids of the pod with this name and of the pods of the Deployment with this name, each once."""
        own = self._by_name.get((namespace, name))
        of_deployment = self._by_deployment.get((namespace, name), ())
        return list(dict.fromkeys([own, *of_deployment] if own is not None else of_deployment))


def _deployment_of(pod: Pod) -> str:
    """Name of the pod's Deployment (its ReplicaSet's without the hash), "" when it has none."""
    owner = controller_of(pod.metadata.owner_references)
    return owner.name.rpartition("-")[0] if owner is not None and owner.kind == "ReplicaSet" else ""


PODS = 0
"""Index of the number of pods; the amount of a resource is at its code + 1."""


class PriorityColumns:
    """One block of (1 + resources, rows) per priority. Made by the first call of `below`, then kept up to date."""

    def __init__(self) -> None:
        self._blocks: dict[int, IntArray] | None = None
        self._shape = (0, 0)

    def __repr__(self) -> str:
        return f"PriorityColumns({sorted(self._blocks) if self._blocks is not None else 'not made'})"

    def count(self, row: int, record: PlacedPod, sign: int) -> None:
        """Count a pod in (+1) or out (-1)."""
        if self._blocks is None:
            return
        if row >= self._shape[1] or any(code + 1 >= self._shape[0] for code, _ in record.requested):
            self._blocks = None  # the table grew: the next call of `below` makes them anew
            return
        block = self._blocks.get(record.priority)
        if block is None:
            block = self._blocks[record.priority] = np.zeros(self._shape, dtype=np.int64)
        block[PODS, row] += sign
        for code, amount in record.requested:
            block[code + 1, row] += sign * amount

    def below(self, priority: int, table: NodeTable, placed: Iterable[PlacedPod]) -> IntArray:
        """Sums over all pods of a lower priority, shape (1 + resources, at least table.size)."""
        needed = (len(table.resources.names) + 1, len(table.valid))
        if self._blocks is None or self._shape[0] < needed[0] or self._shape[1] < needed[1]:
            self._blocks, self._shape = {}, needed
            for record in placed:
                row = table.row_of.get(record.node)
                if row is not None:
                    self.count(row, record, +1)
        assert self._blocks is not None  # noqa: S101 - tells the type checker: counting in the new shape cannot drop it
        total = np.zeros(self._shape, dtype=np.int64)
        for other, block in self._blocks.items():
            if other < priority:
                total += block
        return total


def clash(one: HostPort, other: HostPort) -> bool:
    """May the two not be used on one node? The wildcard address clashes with every address."""
    if (one.protocol, one.port) != (other.protocol, other.port):
        return False
    return one.ip == other.ip or ANY_IP in {one.ip, other.ip}


class PortUsers:
    """Counts of users per (protocol, port), row and address: few nodes have any, so a question touches only those."""

    def __init__(self) -> None:
        self._users: dict[tuple[str, int], dict[int, dict[str, int]]] = {}

    def __repr__(self) -> str:
        return f"PortUsers({len(self._users)} ports)"

    def count(self, row: int, ports: Iterable[HostPort], sign: int) -> None:
        """Count a pod's ports in (+1) or out (-1)."""
        for port in ports:
            rows = self._users.setdefault((port.protocol, port.port), {})
            addresses = rows.setdefault(row, {})
            addresses[port.ip] = addresses.get(port.ip, 0) + sign
            if addresses[port.ip] <= 0:
                del addresses[port.ip]
            if not addresses:
                del rows[row]
            if not rows:
                del self._users[port.protocol, port.port]

    def free(self, wanted: Iterable[HostPort], size: int) -> BoolArray:
        """Rows where none of the wanted ports is taken. The wildcard address clashes with every address."""
        result = np.ones(size, dtype=np.bool_)
        for port in wanted:
            for row, addresses in self._users.get((port.protocol, port.port), {}).items():
                if port.ip == ANY_IP or ANY_IP in addresses or port.ip in addresses:
                    result[row] = False
        return result
