"""What the operator reads of the cluster: slim structs, decoded straight from the watch's bytes.

Only fields a rule reads are listed; managedFields and the rest are skipped while decoding.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import msgspec

from robotapp_api.model.names import Label
from robotapp_api.values.placement.round_trips import Rtt
from robotapp_claims.rules import objects as claims
from robotapp_claims.rules.completion.endings import JobState, build_job_state
from robotapp_claims.rules.instances import robot_of
from robotapp_claims.rules.objects import TelemetryDevice

_LABELS: Final = frozenset(label.value for label in Label)
_SPEC: Final = msgspec.json.Decoder(dict[str, Any])


class Struct(msgspec.Struct, rename="camel", kw_only=True):
    """Base: camelCase on the wire, absent fields take their default."""


MOST_LABELS: Final = 64
"""An object of a tenant with more of them is kept with ours alone: labels have no bound but etcd's."""
MOST_SPEC_BYTES: Final = 1_000_000
"""A child of ours is shorter: all of an app is (`robotapp_api.checks.size`). What a longer one holds was not written by us."""


class Meta(claims.Meta, frozen=True, kw_only=True):
    """What the claim rules read of metadata, and since when the object exists."""

    creation_timestamp: str | None = None


class TenantMeta(Meta, frozen=True, kw_only=True):
    """Metadata of an object that tenants write: what nobody reads of it is not kept."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.labels) > MOST_LABELS:
            ours = {key: value for key, value in self.labels.items() if key in _LABELS}
            msgspec.structs.force_setattr(self, "labels", ours)


def version_number(resource_version: str) -> int:
    """ResourceVersion as a number, 0 when it is none: which of two copies of an object is newer."""
    return int(resource_version) if resource_version.isdecimal() else 0


class ObjectCondition(Struct):
    type: str
    status: str = "Unknown"
    reason: str = ""
    message: str = ""
    last_transition_time: str | None = None


class DeploymentStatus(Struct):
    observed_generation: int = 0
    replicas: int = 0
    ready_replicas: int = 0
    updated_replicas: int = 0
    conditions: list[ObjectCondition] = []


class Spec(Struct):
    """A child of an app; its spec is kept as text and decoded by each reader.

    Nothing of a spec is kept that no RobotApp controls, or that is longer than a child of ours can be: the operator does not
    write such objects, and tenants may make many of them.
    """

    metadata: TenantMeta
    given: dict[str, Any] = msgspec.field(name="spec", default_factory=dict)
    """As decoded; empty afterwards."""
    text: bytes = b""

    def __post_init__(self) -> None:
        if self.given:
            text = msgspec.json.encode(self.given)
            self.given = {}
            ours = self.metadata.controller_uid and self.metadata.controller_uid == self.metadata.app_uid
            self.text = text if ours and len(text) <= MOST_SPEC_BYTES else b""

    @property
    def spec(self) -> dict[str, Any]:
        """The spec, which the caller may change."""
        return _SPEC.decode(self.text) if self.text else {}


class Deployment(Spec):
    status: DeploymentStatus = msgspec.field(default_factory=DeploymentStatus)

    @property
    def replicas(self) -> int:
        return int(self.spec.get("replicas", 1))

    @property
    def is_ready(self) -> bool:
        """Whether all its pods are of the newest template and ready, and there are any."""
        replicas = self.replicas
        return self.is_up_to_date(replicas) and self.status.ready_replicas == replicas > 0

    def is_up_to_date(self, replicas: int) -> bool:
        """Whether it has so many pods, all of the newest template."""
        current = self.status.observed_generation >= self.metadata.generation
        return current and self.status.updated_replicas == replicas == self.status.replicas


class JobStatus(Struct):
    conditions: list[ObjectCondition] = []
    start_time: str | None = None


class Job(Spec):
    """The Job of a component that ends."""

    status: JobStatus = msgspec.field(default_factory=JobStatus)

    @property
    def verdict(self) -> ObjectCondition | None:
        """The condition Complete or Failed of a job that has ended; its pods have ended then, too."""
        return claims.find_verdict(self.status.conditions)

    @property
    def is_complete(self) -> bool:
        return self.verdict is not None and self.verdict.type == claims.COMPLETE

    @property
    def is_suspended(self) -> bool:
        """Whether it starts no pod for now."""
        return self.spec.get("suspend") is True

    @property
    def is_deleting(self) -> bool:
        return self.metadata.deletion_timestamp is not None

    @property
    def may_run(self) -> bool:
        """Whether it has a pod, or will have one."""
        return self.verdict is None and not self.is_suspended

    @property
    def state(self) -> JobState:
        """What the claim rules read of it."""
        return build_job_state(
            self.metadata.annotations,
            self.status.conditions,
            created=self.metadata.creation_timestamp,
            started=self.status.start_time,
            suspended=self.is_suspended,
        )


def pod_spec(deployment: Mapping[str, Any]) -> Mapping[str, Any]:
    """The pod's spec in a Deployment's spec, {} where there is none."""
    return _mapping(_mapping(deployment.get("template")).get("spec"))


def pod_annotations(deployment: Mapping[str, Any]) -> Mapping[str, str]:
    """The pod's annotations in a Deployment's spec, {} where there are none."""
    return _mapping(_mapping(_mapping(deployment.get("template")).get("metadata")).get("annotations"))


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


class Ingress(Struct):
    """An address at which a load balancer serves."""

    ip: str = ""
    hostname: str = ""


class LoadBalancerStatus(Struct):
    ingress: list[Ingress] = []


class ServiceStatus(Struct):
    load_balancer: LoadBalancerStatus = msgspec.field(default_factory=LoadBalancerStatus)


class GivenPort(Struct):
    """A port of a Service as the API server stores it."""

    name: str = ""
    port: int = 0
    node_port: int = 0


class Service(Spec):
    """A Service of an app."""

    status: ServiceStatus = msgspec.field(default_factory=ServiceStatus)

    @property
    def type(self) -> str:
        """ClusterIP, NodePort or LoadBalancer."""
        return str(self.spec.get("type") or "ClusterIP")

    @property
    def ports(self) -> list[GivenPort]:
        """Its ports with what the cluster has chosen."""
        return msgspec.convert(self.spec.get("ports") or [], list[GivenPort])


class ReplicaSet(Struct):
    metadata: TenantMeta


MOST_MESSAGE_CHARACTERS: Final = 1024
"""Of a container's state: a program may write 4 KiB of it, and every pod is kept."""


class Waiting(Struct):
    reason: str = ""
    message: str = ""


class Terminated(Struct):
    exit_code: int = 0
    reason: str = ""
    message: str = ""
    finished_at: str | None = None

    def __post_init__(self) -> None:
        self.message = self.message[-MOST_MESSAGE_CHARACTERS:]


class Running(Struct):
    started_at: str | None = None


class ContainerState(Struct):
    running: Running | None = None
    waiting: Waiting | None = None
    terminated: Terminated | None = None


class ContainerStatus(Struct):
    name: str = ""
    ready: bool = False
    restart_count: int = 0
    state: ContainerState = msgspec.field(default_factory=ContainerState)
    last_state: ContainerState = msgspec.field(default_factory=ContainerState)


class PodStatus(Struct):
    phase: str = ""
    reason: str = ""
    message: str = ""
    conditions: list[ObjectCondition] = []
    container_statuses: list[ContainerStatus] = []
    init_container_statuses: list[ContainerStatus] = []


class SchedulingGate(Struct):
    name: str = ""


class PodSpec(Struct):
    node_name: str = ""
    scheduler_name: str = ""
    scheduling_gates: list[SchedulingGate] = []


class Pod(Struct):
    metadata: TenantMeta
    spec: PodSpec = msgspec.field(default_factory=PodSpec)
    status: PodStatus = msgspec.field(default_factory=PodStatus)

    @property
    def terminal(self) -> bool:
        return self.status.phase in ("Succeeded", "Failed")

    @property
    def is_ready(self) -> bool:
        """Whether its condition Ready is True, and it is not about to end."""
        ready = any(c.type == "Ready" and c.status == "True" for c in self.status.conditions)
        return ready and not self.terminal and self.metadata.deletion_timestamp is None


class Taint(Struct):
    key: str = ""
    value: str = ""
    effect: str = ""


class Toleration(Struct):
    key: str = ""
    operator: str = ""
    value: str = ""
    effect: str = ""


class NodeSpec(Struct):
    unschedulable: bool = False
    taints: list[Taint] = []


class NodeAddress(Struct):
    type: str = ""
    address: str = ""


class NodeStatus(Struct):
    conditions: list[ObjectCondition] = []
    addresses: list[NodeAddress] = []


class Node(Struct):
    metadata: Meta
    spec: NodeSpec = msgspec.field(default_factory=NodeSpec)
    status: NodeStatus = msgspec.field(default_factory=NodeStatus)

    @property
    def robot(self) -> str:
        """Name of the robot this node is on, "" for other nodes."""
        return robot_of(self.metadata)

    @property
    def ready(self) -> bool:
        return any(c.type == "Ready" and c.status == "True" for c in self.status.conditions)

    @property
    def address(self) -> str:
        """Where people reach the node, the external address first; "" for none."""
        addresses = {entry.type: entry.address for entry in self.status.addresses}
        return addresses.get("ExternalIP") or addresses.get("InternalIP") or ""

    @property
    def readiness_since(self) -> str | None:
        """When the node became Ready or ceased to be, by the clock of the program that wrote the condition; else when it was created."""
        found = next((c.last_transition_time for c in self.status.conditions if c.type == "Ready"), None)
        return found or self.metadata.creation_timestamp


class TelemetrySpec(Struct):
    probe: list[str] = []


class TelemetryStatus(Struct):
    interval_seconds: int | None = None
    seq: int | None = None
    rtt: list[Rtt] = []
    devices: list[TelemetryDevice] = []


class Telemetry(Struct):
    metadata: Meta
    spec: TelemetrySpec = msgspec.field(default_factory=TelemetrySpec)
    status: TelemetryStatus = msgspec.field(default_factory=TelemetryStatus)


class ConfigMap(Struct):
    metadata: Meta
    data: dict[str, str] = {}
    binary_data: dict[str, str] = {}


class ChildRef(NamedTuple):
    """A child within its app's namespace."""

    kind: str
    name: str


def lacks_owner(telemetry: Telemetry, node: Node | None) -> bool:
    """Is there a node of this name that does not own the object?"""
    uid = node.metadata.uid if node else ""
    return bool(uid) and all(owner.uid != uid for owner in telemetry.metadata.owner_references)
