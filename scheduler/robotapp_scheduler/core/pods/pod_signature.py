"""Results shared by all pods with the same spec, labels and owner: 2,000 replicas have one `PodSignature`.

`required_features_of` finds the kubelet features that a spec needs, by the names under which nodes declare them.
"""

from collections.abc import Hashable, Mapping
from itertools import count
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_api.values.quantities.requests import PodRequests, pod_requests
from robotapp_scheduler.core.api.core_v1 import Container, Pod, PodSpec, controller_of
from robotapp_scheduler.core.nodes.columns import ResourceColumns
from robotapp_scheduler.core.pods.cached_property import CachedProperty
from robotapp_scheduler.core.pods.limits import exceeded_limit
from robotapp_scheduler.core.selectors.affinity_terms import affinity_key
from robotapp_scheduler.core.selectors.label_sets import LabelSetKey, label_key

RESTART_ALL: Final = "RestartAllContainersOnContainerExits"
USER_NAMESPACES: Final = "UserNamespacesHostNetworkSupport"
MOUNT_OPTIONS: Final = "VolumeBindMountOptions"
NOTHING: Final[frozenset[str]] = frozenset()


def required_features_of(spec: PodSpec) -> frozenset[str]:
    """The kubelet features that the node must have declared; none for nearly every pod."""
    containers = spec.containers if not spec.init_containers else [*spec.containers, *spec.init_containers]
    found: set[str] = set()
    if spec.host_network and not spec.host_users:
        found.add(USER_NAMESPACES)
    for container in containers:
        if any(rule.action == "RestartAllContainers" for rule in container.restart_policy_rules):
            found.add(RESTART_ALL)
        if any(mount.bind_mount_options for mount in container.volume_mounts):
            found.add(MOUNT_OPTIONS)
    return frozenset(found) if found else NOTHING


ANY_IP: Final = "0.0.0.0"  # noqa: S104 - the wildcard a hostPort without hostIP stands for, nothing is bound here
MAX_SIGNATURES: Final = 2048
MOST_KEY_BYTES: Final = 16_384
"""Pods with a longer key share no signature: two thousand keys of 1.5 MB would fill the memory."""
_numbers: Final = count(1)
_encode: Final = msgspec.msgpack.Encoder().encode


class HostPort(NamedTuple):
    """A port the pod takes on its node."""

    ip: str
    protocol: str
    port: int


class PodSignature:
    """Results that follow from what `PodSignatures` compares. `pod` is any of the pods that have it."""

    def __init__(self, pod: Pod) -> None:
        self._pod = pod
        self.number = next(_numbers)
        """Distinguishes signatures; a signature that was dropped and made again has another one."""
        self.keys: dict[tuple[str, ...], tuple[Hashable, ...]] = {}
        """Features of such pods by their names (core.pods.pod_info)."""
        self.facts: dict[str, Hashable] = {}
        """Single features by name."""
        self.notes: dict[object, Any] = {}
        """What plugins and runners compute once for such pods, by plugin or key."""

    def __repr__(self) -> str:
        return f"PodSignature(of {self._pod.key})"

    @CachedProperty
    def exceeded_limit(self) -> str:
        """Which limit of core.pods.limits such pods exceed, so that they are not tried; "" for nearly every pod."""
        return exceeded_limit(self._pod.spec)

    @CachedProperty
    def requests(self) -> PodRequests:
        """Sums of resources; raises ValueError when a quantity cannot be read."""
        return requests_of(self._pod)

    @CachedProperty
    def affinity_key(self) -> bytes:
        """Pod affinity and anti-affinity as a key, b"" without any."""
        return affinity_key(self._pod.spec.affinity)

    @CachedProperty
    def label_key(self) -> LabelSetKey:
        """Namespace and labels as a key."""
        meta = self._pod.metadata
        return label_key(meta.namespace, meta.labels or {})

    @CachedProperty
    def images(self) -> tuple[str, ...]:
        """Images of init containers, containers and image volumes, by the names nodes report them under."""
        return images(self._pod)

    @CachedProperty
    def host_ports(self) -> tuple[HostPort, ...]:
        """Ports such a pod takes on its node, each once."""
        return host_ports(self._pod)

    @CachedProperty
    def needs(self) -> frozenset[str]:
        """Features the node must declare."""
        return required_features_of(self._pod.spec)

    def held(self, columns: ResourceColumns) -> tuple[tuple[int, int], ...]:
        """Amounts such a pod holds, by index of their columns; kept unless the columns lack some of its resources."""
        found: tuple[tuple[int, int], ...] | None = self.notes.get(columns)
        if found is None:
            exact = self.requests.exact
            found = columns.held(exact)
            if len(found) == sum(amount > 0 for amount in exact.values()):
                self.notes[columns] = found
        return found


class PodSignatures:
    """The signatures of the pods of one cluster, so that replicas share theirs."""

    __slots__ = ("_by_key",)

    def __init__(self) -> None:
        self._by_key: dict[bytes, PodSignature] = {}

    def __repr__(self) -> str:
        return f"PodSignatures({len(self._by_key)} kept)"

    def of(self, pod: Pod) -> PodSignature:
        """The signature of a pod. What distinguishes replicas (name, uid, node, annotations, status) is not part of it."""
        if pod.status.resizes:
            return PodSignature(pod)  # its container statuses count, too
        try:
            key = _key(pod)
        except OverflowError:  # a number no encoder takes: from no API server
            return PodSignature(pod)
        if len(key) > MOST_KEY_BYTES:
            return PodSignature(pod)
        found = self._by_key.get(key)
        if found is None:
            if len(self._by_key) >= MAX_SIGNATURES:
                self._by_key.clear()
            found = self._by_key[key] = PodSignature(pod)
        return found


def same_signature(old: Pod, labels: Mapping[str, str], new: Pod) -> bool:
    """Whether a pod still has the signature it had with these labels. Compares what `PodSignatures` encodes; False in doubt."""
    if old.status.resizes or new.status.resizes:
        return False
    before, now = old.metadata, new.metadata
    if labels != (now.labels or {}) or before.owner_references != now.owner_references:
        return False
    if old.spec.node_name == new.spec.node_name:
        return old.spec == new.spec
    return msgspec.structs.replace(old.spec, node_name=new.spec.node_name) == new.spec


def _key(pod: Pod) -> bytes:
    meta, spec = pod.metadata, pod.spec
    owner = controller_of(meta.owner_references) if meta.owner_references else None
    return _encode(
        (
            meta.namespace, meta.labels, owner, spec.scheduler_name, spec.priority, spec.containers,
            spec.init_containers, spec.overhead, spec.resources, spec.node_selector, spec.affinity, spec.tolerations,
            spec.topology_spread_constraints, spec.host_network, spec.host_users,
            spec.resource_claims,
            (meta.name, spec.volumes) if spec.volumes else None,  # an ephemeral volume's claim is named after its pod
        )
    )  # fmt: skip


def requests_of(pod: Pod) -> PodRequests:
    """The pod's requests, or what it holds while it is resized in place. Raises ValueError for what is no quantity."""
    return pod_requests(pod.spec, pod.status if pod.status.resizes else None)


def host_ports(pod: Pod) -> tuple[HostPort, ...]:
    """Host ports of containers and sidecars, in order, each once. Equal ports of one pod never clash with themselves."""
    found: dict[HostPort, None] = {}
    for container in _port_holders(pod):
        for port in container.ports or ():
            if port.host_port > 0:
                found[HostPort(port.host_ip or ANY_IP, port.protocol or "TCP", port.host_port)] = None
    return tuple(found)


def images(pod: Pod) -> tuple[str, ...]:
    """Image names, ":latest" added where there is no tag (a digest counts as one), one per mention."""
    spec = pod.spec
    found = [container.image for container in (*(spec.init_containers or ()), *spec.containers)]
    found += [volume.image.reference for volume in spec.volumes or () if volume.image is not None]
    return tuple(name if name.rfind(":") > name.rfind("/") else f"{name}:latest" for name in found)


def _port_holders(pod: Pod) -> list[Container]:
    sidecars = [c for c in pod.spec.init_containers or () if c.restart_policy == "Always"]
    return [*pod.spec.containers, *sidecars]
