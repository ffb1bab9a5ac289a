"""What can change, as flags.

One vocabulary serves three readers: the change log (which node rows a cached result must look at again), the queue
(which waiting pods a change may help) and the plugins (`node_reads` and `events`).
"""

from collections.abc import Iterable
from enum import IntFlag, auto
from functools import cache
from typing import Any, Final, Protocol

import msgspec


class Change(IntFlag):
    """Kinds of change. Methods of `Cache` return what they changed; the caller passes it to the queue's `move`."""

    NONE = 0
    NODE_ADDED = auto()
    NODE_REMOVED = auto()
    ALLOCATABLE = auto()
    LABELS = auto()
    TAINTS = auto()
    """Taints or spec.unschedulable."""
    ANNOTATIONS = auto()
    POD_ADDED = auto()
    """A pod was placed on a node (assumed or seen)."""
    POD_REMOVED = auto()
    """A placed pod is gone, terminal or forgotten: room was freed."""
    POD_UPDATED = auto()
    """A placed pod changed labels, size or started to terminate."""
    POD_SEEN = auto()
    """A pod without a node appeared, changed or disappeared (groups count them)."""
    RTT = auto()
    DEVICES = auto()
    """A node's devices, by telemetry or labels."""
    CLAIMS = auto()
    """A RobotClaim appeared, changed or disappeared."""
    LOAD = auto()
    APPS = auto()
    """A RobotApp changed."""
    OWNERS = auto()
    """A ReplicaSet or Deployment changed."""
    NAMESPACES = auto()
    """A namespace came, went or changed labels."""
    SELECTORS = auto()
    """A Service or workload came, went or changed its selector."""
    IMAGES = auto()
    """A node reports other container images."""
    FACTS = auto()
    """A value that a plugin derives from its node changed (core.nodes.node_facts)."""
    PVC = auto()
    """A PersistentVolumeClaim appeared or changed."""
    PV = auto()
    """A PersistentVolume appeared, changed or is free again."""
    STORAGE_CLASS = auto()
    CSI_NODE = auto()
    CSI_DRIVER = auto()
    CAPACITY = auto()
    """A CSIStorageCapacity appeared or changed."""
    ATTACHMENT = auto()
    """A VolumeAttachment is gone."""
    FEATURES = auto()
    """The features that a node's kubelet declares."""
    RESOURCE_CLAIMS = auto()
    """A ResourceClaim came, went, was allocated or shared with another pod."""
    RESOURCE_SLICES = auto()
    """A ResourceSlice or DeviceTaintRule appeared or changed: nodes may offer other devices."""
    DEVICE_CLASSES = auto()
    """A DeviceClass appeared or changed."""
    POD_GROUPS = auto()
    """A PodGroup came, went or changed its requirements."""
    SELF = auto()
    """A waiting pod itself changed (spec, labels or annotations); concerns that pod alone."""
    NOMINATED = auto()
    """A waiting pod gave up the node it was nominated for."""
    TERMS = auto()
    """The pod that was placed or is gone has affinity terms; in the change log only, beside POD_ADDED and the like."""
    TENANTS = auto()
    """A node admits other namespaces than before; logged for every row, because the annotation holds for the whole robot."""
    POOLS = auto()
    """A DomainPool may have more ids: sent on a timer, because pools are not watched."""
    ALL = (1 << 40) - 1
    """Every kind, those that are added here later, too."""


NODE: Final = Change.NODE_ADDED | Change.NODE_REMOVED
NODE_COMES_OR_GOES: Final = int(NODE)
"""NODE as a plain int."""
PLACED: Final = Change.POD_ADDED | Change.POD_REMOVED | Change.POD_UPDATED
_OF_ONE_POD: Final = int(Change.POD_UPDATED | Change.SELF)


class Event(msgspec.Struct, frozen=True, gc=False):
    """One change as a queueing hint sees it. `old` is None for what appeared, `new` for what is gone.

    `resource` is the plural of the watched resource ("pods", "nodes", "persistentvolumes" …), the objects are the structs
    its watch decodes. Time and telemetry have neither: resource "", no object.
    """

    resource: str
    change: Change
    old: Any = None
    new: Any = None

    @property
    def action(self) -> str:
        """One of "add", "update" and "delete"; "" without an object."""
        if self.old is None:
            return "" if self.new is None else "add"
        return "delete" if self.new is None else "update"

    @property
    def label(self) -> str:
        """Upstream's name of the event where it has one, for scheduler_queue_incoming_pods_total."""
        if int(self.change) & _OF_ONE_POD and self.old is not None and self.new is not None:
            whose = "TargetPod" if self.change & Change.SELF else "AssignedPod"
            return f"{whose}Update{_changed(self.old, self.new)}"
        return _label(self.change, self.action)


def _changed(old: Any, new: Any) -> str:
    """Upstream's name of the difference between two states of a pod; "" where it has none."""
    if old.spec.scheduling_gates and not new.spec.scheduling_gates:
        return "PodSchedulingGatesEliminated"
    if old.metadata.labels != new.metadata.labels:
        return "PodLabel"
    return "PodToleration" if old.spec.tolerations != new.spec.tolerations else ""


@cache
def _label(found: Change, action: str) -> str:
    """`Event.label` without objects. Cached: there are few combinations, and testing flags one by one costs more than a decision."""
    kind = next((kind for change, kind in _STORAGE if change & found), "")
    if kind and action and not found & Change.POD_REMOVED:
        return kind + action.capitalize()
    return next((name for change, name in _LABELS if change & found), found.name or "Change")


_STORAGE: Final = (
    (Change.PVC, "PersistentVolumeClaim"),
    (Change.PV, "PersistentVolume"),
    (Change.STORAGE_CLASS, "storage.k8s.io/StorageClass"),
    (Change.CSI_NODE, "storage.k8s.io/CSINode"),
    (Change.CSI_DRIVER, "storage.k8s.io/CSIDriver"),
    (Change.CAPACITY, "storage.k8s.io/CSIStorageCapacity"),
    (Change.ATTACHMENT, "storage.k8s.io/VolumeAttachment"),
    (Change.RESOURCE_CLAIMS, "resource.k8s.io/ResourceClaim"),
    (Change.RESOURCE_SLICES, "resource.k8s.io/ResourceSlice"),
    (Change.DEVICE_CLASSES, "resource.k8s.io/DeviceClass"),
)
_LABELS: Final = (
    (Change.NODE_ADDED, "NodeAdd"),
    (Change.NODE_REMOVED, "NodeDelete"),
    (Change.ALLOCATABLE, "NodeUpdateNodeAllocatable"),
    (Change.LABELS, "NodeUpdateNodeLabel"),
    (Change.TAINTS, "NodeUpdateNodeTaint"),
    (Change.ANNOTATIONS, "NodeUpdateNodeAnnotation"),
    (Change.FEATURES, "NodeUpdateNodeDeclaredFeature"),
    (Change.NAMESPACES, "NamespaceLabelChange"),
    (Change.POD_ADDED, "AssignedPodAdd"),
    (Change.POD_REMOVED, "AssignedPodDelete"),
    (Change.POD_UPDATED, "AssignedPodUpdate"),
    (Change.SELF, "TargetPodUpdate"),
    (Change.NOMINATED, "UnscheduledPodDelete"),
)

OF_PODS: Final = PLACED
"""Changes that placed pods make."""
CHANGES_OF_PODS: Final = int(PLACED | Change.TERMS)
"""All kinds of change of placed pods in the change log, as a plain int."""
OFFERED: Final = int(NODE | Change.ALLOCATABLE)
"""After these, nodes may offer something else."""

READS: Final[dict[str, Change]] = {
    "name": NODE,
    "allocatable": NODE | Change.ALLOCATABLE,
    "requested": NODE | PLACED,
    "ports": NODE | PLACED,
    "pods": NODE | PLACED,
    "labels": NODE | Change.LABELS,
    "taints": NODE | Change.TAINTS,
    "annotations": NODE | Change.ANNOTATIONS,
    "tenants": NODE | Change.TENANTS,
    "rtt": NODE | Change.RTT,
    "devices": NODE | Change.DEVICES | Change.LABELS | Change.CLAIMS | PLACED,
    "load": NODE | Change.LOAD,
    "features": NODE | Change.FEATURES,
    "namespaces": NODE | Change.NAMESPACES,
    "selectors": NODE | Change.SELECTORS,
    "images": NODE | Change.IMAGES,
    "resource_claims": NODE | Change.RESOURCE_CLAIMS | Change.RESOURCE_SLICES | Change.DEVICE_CLASSES,
    "terms": NODE | Change.TERMS,
    "facts": NODE | Change.FACTS,
}
"""`node_reads` of a plugin → the changes after which its result for that row must be computed again. "facts" are those that plugins define."""


class OwnFact(Protocol):
    """A fact that a plugin defines itself, in `node_reads` (core.nodes.node_facts.NodeFact)."""

    @property
    def changes(self) -> Change:
        """As a value of READS."""


def interest_of(node_reads: Iterable[str | OwnFact]) -> int:
    """The changes that concern a reader of these facts, as a plain int. Unknown names are KeyErrors."""
    found = Change.NONE
    for fact in node_reads:
        found |= READS[fact] if isinstance(fact, str) else fact.changes
    return int(found)
