"""A pod prepared for scheduling, and the compact record of a pod that is placed.

`PodInfo` computes everything a rule reads once, when the pod is first seen; `PlacedPod` keeps under 1 kB of each of
tens of thousands of running pods.
"""

from collections.abc import Callable, Hashable
from functools import cache
from typing import Final, NamedTuple

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.quantities.requests import PodRequests
from robotapp_scheduler.core.api.annotations import any_read, parse_annotations
from robotapp_scheduler.core.api.core_v1 import Affinity, NodeAffinity, OwnerReference, Pod, Toleration, controller_of
from robotapp_scheduler.core.api.ros import InvalidAnnotation, RosContext, RosRequest
from robotapp_scheduler.core.dynamic_resources.claims_of_pods import PodClaims, list_named_claims
from robotapp_scheduler.core.pods.cached_property import CachedProperty
from robotapp_scheduler.core.pods.domain_variable import find_lost_domain
from robotapp_scheduler.core.pods.pod_group_index import group_ref_of, in_group
from robotapp_scheduler.core.pods.pod_signature import HostPort, PodSignature
from robotapp_scheduler.core.pods.pod_volumes import PodVolumes, volumes_of
from robotapp_scheduler.core.selectors.affinity_index import PlacedTerm
from robotapp_scheduler.core.selectors.affinity_terms import attracts_itself
from robotapp_scheduler.core.selectors.label_sets import LabelSet

ROS_FEATURES: Final = "ros"
VOLUME_FEATURE: Final = "volumes"
CLAIM_FEATURE: Final = "claims"
OWN_FEATURES: Final = frozenset({"uid", "name", "annotations", "annotated_hardware", "node_name", "resource_claims"})
"""Features in which replicas differ; the others follow from the pod's signature."""
LIVE: Final = (ROS_FEATURES, VOLUME_FEATURE, CLAIM_FEATURE)
"""Features that depend on more than the pod: found anew at each attempt, never kept."""
NO_ROS: Final[tuple[Hashable, ...]] = (None,)
"""Key of every plugin that reads parts of "ros", for a pod without ROS fields."""
SYSTEM_CRITICAL: Final = 2_000_000_000
"""Priorities from here on belong to system-node-critical and system-cluster-critical."""


class Member(NamedTuple):
    """The part of a RobotApp that a pod's labels name; the owner chain confirms it."""

    app_uid: str
    instance: str
    component: str


class PodInfo:
    """One pod as rules see it. Everything is read-only; `ros` is set anew at the start of each attempt."""

    def __init__(self, pod: Pod, signature: PodSignature | None = None) -> None:
        """`signature` is shared with other replicas (Cache.pod_info); without it the pod has its own."""
        meta = pod.metadata
        self.pod = pod
        self.uid = meta.uid
        self.name = meta.name
        self.namespace = meta.namespace
        self.labels: dict[str, str] = meta.labels or {}
        self.annotations: dict[str, str] = meta.annotations or {}
        self._annotated = bool(self.annotations) and any_read(self.annotations)
        self.priority = pod.spec.priority
        grouped = in_group(pod)
        self.member = member_of(self.labels) if grouped else None
        self.pod_group = group_ref_of(pod) if grouped else None
        self.ros: RosContext | None = None
        self.qos: tuple[str, str, str] | None = None
        """(QoS class, reliability, liveliness) for the queue; None for a pod without ROS fields."""
        self.volume_key: Hashable = None
        """What its volumes look like right now; None for a pod without volumes. Set like `ros`."""
        self.claims: PodClaims | None = None
        """Its ResourceClaims as they are right now; None for a pod without any. Set like `ros`, and before its gates are tested."""
        self.signature = PodSignature(pod) if signature is None else signature
        """What it has in common with other replicas."""

    def __repr__(self) -> str:
        return f"PodInfo({self.key}, uid={self.uid}, priority={self.priority})"

    @property
    def key(self) -> str:
        """namespace/name."""
        return f"{self.namespace}/{self.name}"

    @property
    def scheduler_name(self) -> str:
        """Name of the profile that schedules it."""
        return self.pod.spec.scheduler_name

    @property
    def deleting(self) -> bool:
        """A pod that is being deleted is never bound."""
        return self.pod.metadata.deletion_timestamp is not None

    @property
    def system_critical(self) -> bool:
        """Stands before every ROS tier in the queue."""
        return self.priority >= SYSTEM_CRITICAL

    @property
    def exceeded_limit(self) -> str:
        """Why it is refused before anything is looked up for it; empty for every sane pod."""
        return self.signature.exceeded_limit

    @property
    def requests(self) -> PodRequests:
        """Sums of resources; raises ValueError when a quantity cannot be read."""
        return self.signature.requests

    @property
    def tolerations(self) -> tuple[Toleration, ...]:
        """spec.tolerations."""
        return self.pod.spec.tolerations

    @property
    def node_selector(self) -> dict[str, str]:
        """spec.nodeSelector."""
        return self.pod.spec.node_selector or {}

    @property
    def affinity(self) -> Affinity | None:
        """spec.affinity."""
        return self.pod.spec.affinity

    @property
    def node_affinity(self) -> NodeAffinity | None:
        """spec.affinity.nodeAffinity."""
        return self.pod.spec.affinity.node_affinity if self.pod.spec.affinity else None

    @property
    def affinity_key(self) -> bytes:
        """Pod affinity and anti-affinity as a key, b"" without any."""
        return self.signature.affinity_key

    @property
    def images(self) -> tuple[str, ...]:
        """Images of init containers, containers and image volumes, by the names nodes report them under."""
        return self.signature.images

    @property
    def image_volumes(self) -> int:
        """How many of `images`, the last ones, are volumes."""
        return sum(1 for volume in self.pod.spec.volumes or () if volume.image is not None)

    @property
    def host_ports(self) -> tuple[HostPort, ...]:
        """Ports the pod takes on its node, each once."""
        return self.signature.host_ports

    @property
    def volumes(self) -> PodVolumes | None:
        """Claims and inline disks; None for a pod with volumes that decide nothing."""
        return self._volumes if self.pod.spec.volumes else None

    @CachedProperty
    def _volumes(self) -> PodVolumes | None:
        return volumes_of(self.pod)

    @property
    def needs(self) -> frozenset[str]:
        """Features the node must declare."""
        return self.signature.needs

    @property
    def controller(self) -> OwnerReference | None:
        """The owner that manages this pod."""
        return controller_of(self.pod.metadata.owner_references)

    @property
    def plain(self) -> bool:
        """Surely neither part of a group nor a pod with ROS fields."""
        return self.member is None and self.pod_group is None and not self._annotated

    @property
    def budget_without_end(self) -> bool:
        """Does an annotation state a latency budget, and none of the pod's fields to what?"""
        request = self.ros_request
        if not isinstance(request, RosRequest) or request.latency_budget_us is None:
            return False
        return not (request.master_node or request.peer_pods or Label.ROBOT in self.labels)

    @property
    def ros_request(self) -> RosRequest | InvalidAnnotation | None:
        """Requirements of the scheduler.robotics.io annotations; None without any."""
        return self._ros_request if self._annotated else None

    @CachedProperty
    def _ros_request(self) -> RosRequest | InvalidAnnotation | None:
        request = parse_annotations(self.annotations)
        if isinstance(request, RosRequest) and request.dds_domain:
            return find_lost_domain(self.pod.spec, self.annotations, request.dds_domain) or request
        return request

    def features(self, names: tuple[str, ...]) -> tuple[Hashable, ...]:
        """The values of some features as a key: two pods with equal keys are equal to every rule that reads these."""
        signature = self.signature
        key = signature.keys.get(names)
        if key is None:
            facts = signature.facts
            key = tuple([facts[name] if name in facts else self._feature(name) for name in names])
            if _shared(names):
                signature.keys[names] = key
        return key

    def _feature(self, name: str) -> Hashable:
        value = FEATURES[name](self)
        if name not in OWN_FEATURES:
            self.signature.facts[name] = value
        return value

    def live_features(self, names: tuple[str, ...]) -> tuple[Hashable, ...]:
        """The same for volumes, resource claims, or parts of "ros": resolved anew at each attempt, so never kept."""
        if names == (VOLUME_FEATURE,):
            return (self.volume_key,)
        if names == (CLAIM_FEATURE,):
            return (self.claims and self.claims.key,)
        return NO_ROS if self.ros is None else tuple(FEATURES[name](self) for name in names)


@cache
def _shared(names: tuple[str, ...]) -> bool:
    """Do pods of one signature share these features?"""
    return OWN_FEATURES.isdisjoint(names)


def _sorted_items(mapping: dict[str, str]) -> Hashable:
    return tuple(sorted(mapping.items())) if mapping else ()


def _request_key(pod: PodInfo) -> Hashable:
    requests = pod.requests
    return (tuple(sorted(requests.exact.items())), tuple(sorted(requests.scored.items())))


FEATURES: Final[dict[str, Callable[[PodInfo], Hashable]]] = {
    "uid": lambda pod: pod.uid,
    "name": lambda pod: pod.name,
    "namespace": lambda pod: pod.namespace,
    "labels": lambda pod: _sorted_items(pod.labels),
    "annotations": lambda pod: _sorted_items(pod.annotations),
    "annotated_hardware": lambda pod: getattr(pod.ros_request, "hardware", ()),
    "priority": lambda pod: pod.priority,
    "requests": _request_key,
    "node_name": lambda pod: pod.pod.spec.node_name,
    "node_selector": lambda pod: _sorted_items(pod.node_selector),
    "node_affinity": lambda pod: pod.node_affinity,
    "affinity": lambda pod: msgspec.json.encode(pod.affinity) if pod.affinity else b"",
    "pod_affinity": lambda pod: pod.affinity_key,
    "self_affinity": lambda pod: attracts_itself(pod.namespace, pod.labels, pod.affinity),
    "controller": lambda pod: (owner.api_version, owner.kind, owner.name) if (owner := pod.controller) else None,
    "group": lambda pod: pod.member if pod.member is not None else pod.pod_group,
    "images": lambda pod: pod.images,
    "tolerations": lambda pod: pod.tolerations,
    "host_ports": lambda pod: pod.host_ports,
    "needs": lambda pod: pod.needs,
    "mounts": lambda pod: (pod.namespace, pod.volumes),
    VOLUME_FEATURE: lambda pod: pod.volume_key,
    "spread": lambda pod: spread_key(pod.pod),
    "spread_labels": lambda pod: tuple(
        (key, pod.labels.get(key)) for each in pod.pod.spec.topology_spread_constraints for key in each.match_label_keys
    ),
    "resource_claims": lambda pod: (
        (pod.namespace, *list_named_claims(pod.pod)) if pod.pod.spec.resource_claims else None
    ),
    CLAIM_FEATURE: lambda pod: pod.claims and pod.claims.key,
    "ros": lambda pod: pod.ros,
    "ros.tenant": lambda pod: pod.ros and pod.ros.tenant,
    "ros.qos": lambda pod: pod.ros and pod.ros.qos_class,
    "ros.topology": lambda pod: pod.ros and (pod.ros.zones, pod.ros.master_node),
    "ros.endpoints": lambda pod: pod.ros and (pod.ros.endpoints, pod.ros.unknown_end),
    "ros.links": lambda pod: pod.ros and (pod.ros.flows, pod.ros.links),
    "ros.objective": lambda pod: pod.ros and pod.ros.balance,
    "ros.deadline": lambda pod: pod.ros and (pod.ros.deadline_us, pod.ros.endpoints),
    "ros.hardware": lambda pod: pod.ros and (pod.ros.hardware, pod.ros.devices),
    "ros.peers": lambda pod: pod.ros and (pod.ros.together, pod.ros.apart, pod.ros.volumes),
    "ros.devices": lambda pod: pod.ros and (pod.ros.devices, pod.ros.holder),
}
"""What a plugin may name in `reads`. The parts of "ros" are None for a pod without ROS fields; a plugin names parts of
"ros", or "volumes" (which stands for everything about them, claims and their state included), or "claims" (the same for
resource claims), or other features."""


class PlacedPod(msgspec.Struct, gc=False):
    """What a running pod occupies. `requested` and `scored` are (resource index, amount) pairs."""

    uid: str
    name: str
    namespace: str
    node: str
    labels: dict[str, str]
    priority: int
    requested: tuple[tuple[int, int], ...]
    scored_cpu_milli: int
    scored_memory_bytes: int
    ports: tuple[HostPort, ...]
    terminating: bool
    assumed: bool
    member: Member | None
    volumes: PodVolumes | None
    pod: Pod
    """Kept for owner chains and for events about the pod; shared with the watch's store, so it costs a pointer."""
    affinity: bytes = b""
    """`PodInfo.affinity_key`."""
    label_set: LabelSet | None = None
    """Where pods with these labels are; set while the pod is placed."""
    terms: tuple[PlacedTerm, ...] = ()
    """Its affinity terms as the cluster counts them; set while the pod is placed."""
    signature: int = 0
    """Number of the pod's signature."""

    @property
    def footprint(self) -> tuple[object, ...]:
        """What others can notice of it on its node."""
        amounts = (self.requested, self.scored_cpu_milli, self.scored_memory_bytes)
        return (self.node, *amounts, self.ports, self.labels, self.terminating)


def member_of(labels: dict[str, str]) -> Member | None:
    """The RobotApp part named by the labels, None for any other pod."""
    uid = labels.get(Label.APP_UID)
    if not uid:
        return None
    return Member(uid, labels.get(Label.INSTANCE, ""), labels.get(Label.COMPONENT, ""))


def same_groups(one: Pod, other: Pod) -> bool:
    """Do two versions of a pod belong to the same RobotApp or PodGroup, or both to none?"""
    labels, others = one.metadata.labels or {}, other.metadata.labels or {}
    return labels == others or (member_of(labels), group_ref_of(one)) == (member_of(others), group_ref_of(other))


def spread_key(pod: Pod) -> bytes:
    """The topology spread constraints as a key, b"" without any."""
    constraints = pod.spec.topology_spread_constraints
    return msgspec.json.encode(constraints) if constraints else b""
