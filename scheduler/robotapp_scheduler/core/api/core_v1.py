"""What the scheduler reads of Kubernetes objects: slim structs, decoded straight from the API server's bytes.

Only fields that a rule looks at are here, everything else is skipped by the decoder. The structs are `gc=False`
(the collector would otherwise walk 50,000 pods) and are never changed after decoding.
The RobotApp side (RobotApp, NodeTelemetry) is in `robotics_v1alpha1.py`, claims are in `robotapp_claims.rules.objects`,
a pod's volumes in `volume_source.py`.
"""

from typing import Any, Final

import msgspec

from robotapp_api.model.names import Label
from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_scheduler.core.api.kept_annotations import bound_annotations
from robotapp_scheduler.core.api.structs import Slim, SlimValue
from robotapp_scheduler.core.api.volume_source import Volume, deciding

Labels = dict[str, str]
Quantity = str | int | float
Resources = dict[str, Quantity]

# Well-known labels with zone and region of nodes and volumes, which upstream defines in core/v1, too.
ZONE: Final = str(Label.ZONE)
REGION: Final = "topology.kubernetes.io/region"
OLD_ZONE: Final = "failure-domain.beta.kubernetes.io/zone"
OLD_REGION: Final = "failure-domain.beta.kubernetes.io/region"
TODAY: Final = {OLD_ZONE: ZONE, OLD_REGION: REGION, ZONE: ZONE, REGION: REGION}
"""Each label → today's name of it."""
SEPARATOR: Final = "__"
"""Separates the zones in the label of a volume that is in several."""


class OwnerReference(Slim):
    """One entry of metadata.ownerReferences."""

    kind: str = ""
    name: str = ""
    uid: str = ""
    api_version: str = ""
    controller: bool = False


def controller_of(owners: list[OwnerReference] | None) -> OwnerReference | None:
    """Returns the owner that manages an object, None without one."""
    for owner in owners or ():
        if owner.controller:
            return owner
    return None


class Metadata(Slim):
    """The part of metadata every object shares."""

    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    generation: int = 0
    labels: Labels | None = None
    annotations: Labels | None = None
    owner_references: list[OwnerReference] | None = None
    finalizers: list[str] | None = None
    deletion_timestamp: str | None = None
    creation_timestamp: str | None = None

    def __post_init__(self) -> None:
        if self.annotations is not None:
            self.annotations = bound_annotations(self.annotations)


# --- Pod ---------------------------------------------------------------------------------------------------------


class ContainerPort(Slim):
    """A declared port; only host ports matter here."""

    host_port: int = 0
    host_ip: str = msgspec.field(name="hostIP", default="")
    protocol: str = "TCP"


class ResourceRequirements(Slim):
    """Requests of a container or of a whole pod. Limits default requests at the API server already."""

    requests: Resources | None = None


class RestartRule(Slim):
    """containers[].restartPolicyRules entry."""

    action: str = ""


class VolumeMount(Slim):
    """Only what a node's runtime may be unable to do."""

    bind_mount_options: tuple[str, ...] = ()


class EnvVar(SlimValue, frozen=True):
    """containers[].env entry. Taken as it is: what the API server would refuse must not keep a dump from being read."""

    name: Any = ""
    value: Any = ""
    value_from: Any = None


class Container(Slim):
    """A container or init container; `restart_policy: Always` on an init container makes it a sidecar."""

    name: str = ""
    image: str = ""
    resources: ResourceRequirements = msgspec.field(default_factory=ResourceRequirements)
    ports: list[ContainerPort] | None = None
    restart_policy: str = ""
    restart_policy_rules: tuple[RestartRule, ...] = ()
    volume_mounts: tuple[VolumeMount, ...] = ()
    env: tuple[EnvVar, ...] | None = None
    """Of the environment the ROS domain alone is kept, for the bind check."""

    def __post_init__(self) -> None:
        if self.env:
            self.env = tuple(variable for variable in self.env if variable.name == ROS_DOMAIN_ID) or None


class Toleration(SlimValue, frozen=True):
    """spec.tolerations entry."""

    key: str = ""
    operator: str = ""
    value: str = ""
    effect: str = ""
    toleration_seconds: int | None = None
    """How long a running pod stays on a node with such a NoExecute taint; None = for good. No rule of placing reads it."""


class Requirement(SlimValue, frozen=True):
    """One expression of a node selector term or a label selector."""

    key: str = ""
    operator: str = ""
    values: tuple[str, ...] = ()


class NodeSelectorTerm(SlimValue, frozen=True):
    """Expressions that must all hold. A term without any matches nothing."""

    match_expressions: tuple[Requirement, ...] = ()
    match_fields: tuple[Requirement, ...] = ()


class NodeSelector(SlimValue, frozen=True):
    """Terms of which one must hold."""

    node_selector_terms: tuple[NodeSelectorTerm, ...] = ()


class PreferredTerm(SlimValue, frozen=True):
    """A term that adds its weight where it holds."""

    weight: int = 0
    preference: NodeSelectorTerm = msgspec.field(default_factory=NodeSelectorTerm)


class NodeAffinity(SlimValue, frozen=True):
    """affinity.nodeAffinity."""

    required: NodeSelector | None = msgspec.field(name="requiredDuringSchedulingIgnoredDuringExecution", default=None)
    preferred: tuple[PreferredTerm, ...] = msgspec.field(
        name="preferredDuringSchedulingIgnoredDuringExecution", default=()
    )


class PodAffinityTerm(Slim):
    """One inter-pod (anti-)affinity term."""

    topology_key: str = ""
    label_selector: dict[str, Any] | None = None
    namespaces: tuple[str, ...] = ()
    namespace_selector: dict[str, Any] | None = None


class WeightedPodAffinityTerm(Slim):
    """A term that adds its weight (affinity) or takes it off (anti-affinity)."""

    weight: int = 0
    pod_affinity_term: PodAffinityTerm = msgspec.field(default_factory=PodAffinityTerm)


class PodAffinity(Slim):
    """affinity.podAffinity or affinity.podAntiAffinity; preferred terms only score."""

    required: tuple[PodAffinityTerm, ...] = msgspec.field(
        name="requiredDuringSchedulingIgnoredDuringExecution", default=()
    )
    preferred: tuple[WeightedPodAffinityTerm, ...] = msgspec.field(
        name="preferredDuringSchedulingIgnoredDuringExecution", default=()
    )


class Affinity(Slim):
    """spec.affinity."""

    node_affinity: NodeAffinity | None = None
    pod_affinity: PodAffinity | None = None
    pod_anti_affinity: PodAffinity | None = None


class TopologySpreadConstraint(Slim):
    """spec.topologySpreadConstraints entry."""

    topology_key: str = ""
    when_unsatisfiable: str = "DoNotSchedule"
    max_skew: int = 1
    min_domains: int | None = None
    label_selector: dict[str, Any] | None = None
    match_label_keys: tuple[str, ...] = ()
    node_affinity_policy: str = "Honor"
    node_taints_policy: str = "Ignore"


class Named(Slim):
    """Anything of which only the name matters: scheduling gates."""

    name: str = ""


class ClaimReference(Slim):
    """spec.resourceClaims entry (a claim, or a template to make one from), and status.resourceClaimStatuses entry."""

    name: str = ""
    resource_claim_name: str | None = None


class SchedulingGroup(Slim):
    """spec.schedulingGroup: the PodGroup (scheduling.k8s.io) the pod belongs to."""

    pod_group_name: str = ""


class PodSpec(Slim):
    """spec of a Pod."""

    node_name: str = ""
    scheduler_name: str = ""
    containers: list[Container] = msgspec.field(default_factory=list)
    init_containers: list[Container] | None = None
    overhead: Resources | None = None
    resources: ResourceRequirements | None = None
    node_selector: Labels | None = None
    affinity: Affinity | None = None
    tolerations: tuple[Toleration, ...] = ()
    topology_spread_constraints: tuple[TopologySpreadConstraint, ...] = ()
    priority: int = 0
    preemption_policy: str = ""
    host_network: bool = False
    host_users: bool = True
    volumes: list[Volume] | None = None
    """Those that decide something; every pod has a token volume, which does not."""
    scheduling_gates: tuple[Named, ...] = ()
    resource_claims: tuple[ClaimReference, ...] = ()
    scheduling_group: SchedulingGroup | None = None


class PodCondition(Slim):
    """status.conditions entry; the shell compares it before it writes PodScheduled."""

    type: str = ""
    status: str = ""
    reason: str = ""
    message: str = ""


class ContainerStatus(Slim):
    """What the kubelet granted a container, and what is in force; both differ from the spec while it is resized."""

    name: str = ""
    allocated_resources: Resources | None = None
    resources: ResourceRequirements | None = None


class PodStatus(Slim):
    """status of a Pod. Containers that have what their spec requests are left out, so nearly always all of them."""

    phase: str = ""
    reason: str = ""
    message: str = ""
    nominated_node_name: str = ""
    start_time: str | None = None
    conditions: list[PodCondition] | None = None
    resource_claim_statuses: tuple[ClaimReference, ...] = ()
    container_statuses: tuple[ContainerStatus, ...] = ()
    init_container_statuses: tuple[ContainerStatus, ...] = ()
    allocated_resources: Resources | None = None
    resources: ResourceRequirements | None = None

    @property
    def resizes(self) -> bool:
        """Does the status hold resources that differ from the spec?"""
        return bool(self.container_statuses) or self.allocated_resources is not None or self.resources is not None

    @property
    def resize_infeasible(self) -> bool:
        """The kubelet reports that the resize cannot be done on this node."""
        for each in self.conditions or ():
            if each.type == "PodResizePending":
                return each.reason == "Infeasible"
        return False


class Pod(Slim):
    """A pod of any scheduler."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: PodSpec = msgspec.field(default_factory=PodSpec)
    status: PodStatus = msgspec.field(default_factory=PodStatus)

    def __post_init__(self) -> None:
        """Keep of volumes and containers' statuses only what may count: tens of thousands of pods would carry them else."""
        spec, status = self.spec, self.status
        if spec.volumes:
            spec.volumes = deciding(spec.volumes)
        reported = status.container_statuses + status.init_container_statuses
        if reported:
            status.container_statuses = reported if _differ(reported, spec) or status.resize_infeasible else ()
            status.init_container_statuses = ()

    @property
    def key(self) -> str:
        """namespace/name."""
        return f"{self.metadata.namespace}/{self.metadata.name}"

    @property
    def terminal(self) -> bool:
        """Succeeded and Failed pods hold nothing, for ever."""
        return self.status.phase in {"Succeeded", "Failed"}


def _differ(reported: tuple[ContainerStatus, ...], spec: PodSpec) -> bool:
    """Does the kubelet report other amounts than the spec for any container?"""
    speaking = [each for each in reported if each.allocated_resources is not None or each.resources is not None]
    if not speaking:
        return False
    wanted = {each.name: each.resources.requests or {} for each in (*spec.containers, *(spec.init_containers or ()))}
    return any(_differs(each, wanted.get(each.name)) for each in speaking)


def _differs(reported: ContainerStatus, wanted: Resources | None) -> bool:
    """An amount written differently counts as different."""
    in_force = reported.resources.requests if reported.resources is not None else None
    if reported.allocated_resources is None and in_force is None:
        return False
    granted = wanted if reported.allocated_resources is None else reported.allocated_resources
    return granted != wanted or (in_force is not None and in_force != wanted)


# --- Node --------------------------------------------------------------------------------------------------------


class Taint(SlimValue, frozen=True):
    """spec.taints entry; the time it was added plays no role."""

    key: str = ""
    value: str = ""
    effect: str = ""


class NodeSpec(Slim):
    """spec of a Node."""

    unschedulable: bool = False
    taints: tuple[Taint, ...] = ()


class NodeImage(SlimValue, frozen=True):
    """status.images entry: one image under all its names."""

    names: tuple[str, ...] | None = None
    """The API server writes null for an image without any: a layer left behind by a newer build."""
    size_bytes: int = 0


class NodeStatus(Slim):
    """status of a Node. Heartbeats change only fields that are not here."""

    allocatable: Resources | None = None
    declared_features: tuple[str, ...] = ()
    images: tuple[NodeImage, ...] = ()


class Node(Slim):
    """A node as the scheduler sees it."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
    spec: NodeSpec = msgspec.field(default_factory=NodeSpec)
    status: NodeStatus = msgspec.field(default_factory=NodeStatus)


# --- Owners ------------------------------------------------------------------------------------------------------


class Owned(Slim):
    """A ReplicaSet, Deployment or Job: only its metadata, for the ownerReference chain pod → RobotApp."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)


class SelectorSpec(Slim):
    """spec.selector: labels (Service, ReplicationController) or a label selector (ReplicaSet, StatefulSet)."""

    selector: dict[str, Any] | None = None


class Selecting(Owned):
    """A Service or workload with a selector: its pods are spread by default."""

    spec: SelectorSpec = msgspec.field(default_factory=SelectorSpec)


class Namespace(Slim):
    """A Namespace: terms of pod affinity may select by its labels."""

    metadata: Metadata = msgspec.field(default_factory=Metadata)
