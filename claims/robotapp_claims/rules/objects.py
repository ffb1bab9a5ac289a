"""The parts of Kubernetes objects the claim rules read, as small structs.

Sweeps decode thousands of these straight from bytes; every field that is not named here is skipped by the decoder.
Optional lists and maps have empty defaults, because the API server leaves empty ones out.
"""

from collections.abc import Iterable
from typing import Any, Final, Protocol, TypeVar

import msgspec

from robotapp_api.model.names import GROUP, OUR_SCHEDULERS, Annotation, ClaimPhase, Label
from robotapp_api.values.replicas import ORDINAL, number_replicas

ROS_DOMAIN_ID: Final = "ROS_DOMAIN_ID"
COMPLETE: Final = "Complete"
FAILED: Final = "Failed"
"""Conditions of a Job that has ended."""
SUSPENDED: Final = "Suspended"
"""Condition of a Job that starts no pod for now."""
OUT_OF_TIME: Final = "DeadlineExceeded"
"""Reason of the condition Failed of a Job whose time was over."""
EXCLUSIVE: Final = "Exclusive"
"""Value of a device's `sharing` that keeps all other pods out."""


class Object(msgspec.Struct, rename="camel", frozen=True, kw_only=True, gc=False):
    """Base of all structs here: camelCase on the wire, immutable, compared by value, no work for the garbage collector.

    Subclasses repeat `frozen` for the type checker; the wire names are inherited.
    """


class OwnerReference(Object, frozen=True, kw_only=True):
    api_version: str = ""
    kind: str = ""
    name: str = ""
    uid: str = ""
    controller: bool = False

    @property
    def is_app(self) -> bool:
        return self.kind == "RobotApp" and self.api_version.startswith(f"{GROUP}/")


_READ: Final = frozenset(annotation.value for annotation in Annotation)


class Meta(Object, frozen=True, kw_only=True):
    """Metadata with the annotations that we read: tenants may write a quarter of a megabyte of others on each object."""

    name: str = ""
    namespace: str = ""
    uid: str = ""
    resource_version: str = ""
    generation: int = 0
    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}
    owner_references: tuple[OwnerReference, ...] = ()
    deletion_timestamp: str | None = None

    def __post_init__(self) -> None:
        if not _READ.issuperset(self.annotations):
            read = {key: value for key, value in self.annotations.items() if key in _READ}
            msgspec.structs.force_setattr(self, "annotations", read)

    @property
    def app_uid(self) -> str:
        return self.labels.get(Label.APP_UID, "")

    @property
    def instance(self) -> str:
        return self.labels.get(Label.INSTANCE, "")

    @property
    def controller(self) -> OwnerReference | None:
        """The owner that controls this object; there is at most one."""
        return next((owner for owner in self.owner_references if owner.controller), None)

    @property
    def controller_uid(self) -> str:
        """Its uid, "" without one."""
        return self.controller.uid if self.controller else ""


# Claims


class DomainThing(Object, frozen=True, kw_only=True):
    pool: str
    scope: str
    id: int
    scope_value: str = ""


class DeviceThing(Object, frozen=True, kw_only=True):
    node: str
    type: str
    id: str
    identity: str = ""


class Holder(Object, frozen=True, kw_only=True):
    """Who holds: a RobotApp's instance (and component, for devices) or a bare pod."""

    api_version: str
    kind: str
    namespace: str
    name: str
    uid: str
    instance: str = ""
    component: str = ""

    @property
    def is_app(self) -> bool:
        return self.kind != "Pod"


class ClaimSpec(Object, frozen=True, kw_only=True):
    holder: Holder
    domain: DomainThing | None = None
    device: DeviceThing | None = None


class ClaimStatus(Object, frozen=True, kw_only=True):
    phase: str = ClaimPhase.RESERVED
    attempt: int = 0
    node: str = ""
    pod: str = ""
    nodes: tuple[str, ...] = ()
    """Nodes where pods with the claimed domain may run, written before each of them is bound."""


class Claim(Object, frozen=True, kw_only=True):
    """A RobotClaim. `metadata.name` is the claimed thing."""

    metadata: Meta
    spec: ClaimSpec
    status: ClaimStatus = ClaimStatus()

    @property
    def name(self) -> str:
        return self.metadata.name

    @property
    def holder(self) -> Holder:
        return self.spec.holder

    @property
    def draining(self) -> bool:
        return self.status.phase == ClaimPhase.DRAINING

    @property
    def parked(self) -> bool:
        return self.status.phase == ClaimPhase.PARKED

    @property
    def nodes(self) -> tuple[str, ...]:
        """Nodes where its pods may run: a create cannot carry the status, so the first one may be an annotation."""
        first = self.metadata.annotations.get(Annotation.FIRST_NODE, "")
        return tuple(sorted({*self.status.nodes, first} - {""})) if first else self.status.nodes

    @property
    def momentary(self) -> bool:
        """Its holder only joins the others that share the device, which takes as long as a binding."""
        return str(Annotation.MOMENTARY) in self.metadata.annotations

    @property
    def standing(self) -> bool:
        """No sweep is about to give it back, so pods may be bound with it."""
        return not (self.draining or self.parked)


class PoolQuota(Object, frozen=True, kw_only=True):
    """default: for each namespace that `namespaces` does not name; None = unlimited, 0 = none."""

    default: int | None = None
    namespaces: dict[str, int] = {}


class PoolSpec(Object, frozen=True, kw_only=True):
    scope: str = "Cluster"
    network: str = ""
    ids: str = ""
    shared_ids: str = ""
    reserved: tuple[int, ...] = ()
    quarantine_seconds: int = 60
    quota: PoolQuota = PoolQuota()
    max_participants_per_host: int = 50


class PoolMeta(Meta, frozen=True, kw_only=True):
    creation_timestamp: str = ""


class Pool(Object, frozen=True, kw_only=True):
    metadata: PoolMeta
    spec: PoolSpec = PoolSpec()
    status: dict[str, Any] = {}


# Workloads


class EnvVar(Object, frozen=True, kw_only=True):
    name: str
    value: str = ""
    value_from: dict[str, Any] | None = None


class Container(Object, frozen=True, kw_only=True):
    env: tuple[EnvVar, ...] = ()


class PodSpec(Object, frozen=True, kw_only=True):
    containers: tuple[Container, ...] = ()
    init_containers: tuple[Container, ...] = ()
    node_name: str = ""
    scheduler_name: str = ""

    @property
    def bound_by_us(self) -> bool:
        """Only our scheduler binds such a pod, and it does so only after the bind check (rule 1)."""
        return bool(self.node_name) and self.scheduler_name in OUR_SCHEDULERS


class PodStatus(Object, frozen=True, kw_only=True):
    phase: str = ""


class Pod(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: PodSpec = PodSpec()
    status: PodStatus = PodStatus()

    @property
    def terminal(self) -> bool:
        """The containers have ended for good. A terminating pod is not terminal: it may still transmit."""
        return self.status.phase in {"Succeeded", "Failed"}


class Template(Object, frozen=True, kw_only=True):
    metadata: Meta = Meta()
    spec: PodSpec = PodSpec()


class DeploymentSpec(Object, frozen=True, kw_only=True):
    template: Template = Template()
    replicas: int = 1


class Deployment(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: DeploymentSpec = DeploymentSpec()


class ReplicaSetStatus(Object, frozen=True, kw_only=True):
    replicas: int = 0


class ReplicaSet(Object, frozen=True, kw_only=True):
    metadata: Meta
    spec: DeploymentSpec = DeploymentSpec()
    status: ReplicaSetStatus = ReplicaSetStatus()


class JobMeta(Meta, frozen=True, kw_only=True):
    creation_timestamp: str = ""


class JobCondition(Object, frozen=True, kw_only=True):
    type: str = ""
    status: str = ""
    reason: str = ""
    message: str = ""
    last_transition_time: str = ""


class JobConditionLike(Protocol):
    """A Job's condition, in whatever struct it was decoded into."""

    @property
    def type(self) -> str: ...

    @property
    def status(self) -> str: ...

    @property
    def reason(self) -> str: ...

    @property
    def last_transition_time(self) -> str | None: ...


AnyCondition = TypeVar("AnyCondition", bound=JobConditionLike)


def find_verdict(conditions: Iterable[AnyCondition]) -> AnyCondition | None:
    """Returns the condition Complete or Failed of a job that has ended, so that its pods have ended, too."""
    return next((item for item in conditions if item.type in {COMPLETE, FAILED} and item.status == "True"), None)


def is_stopped(conditions: Iterable[JobConditionLike]) -> bool:
    """Tells whether the Job controller has stopped a suspended job, and has not yet started it again."""
    return any(item.type == SUSPENDED and item.status == "True" for item in conditions)


class JobSpec(DeploymentSpec, frozen=True, kw_only=True):
    suspend: bool = False


class JobStatus(Object, frozen=True, kw_only=True):
    conditions: tuple[JobCondition, ...] = ()
    start_time: str = ""
    """When it was started last; a Job that goes on after it was suspended gets another time."""

    @property
    def verdict(self) -> JobCondition | None:
        """The condition Complete or Failed of a job none of whose pods will run any more."""
        return find_verdict(self.conditions)


class Job(Object, frozen=True, kw_only=True):
    """A Job of a component that ends; its template counts as long as the job has no verdict."""

    metadata: JobMeta
    spec: JobSpec = JobSpec()
    status: JobStatus = JobStatus()


# Apps, as far as the sweep reads whether they still want something


class SharedApp(Object, frozen=True, kw_only=True):
    name: str
    namespace: str = ""


class Ros2(Object, frozen=True, kw_only=True):
    domain: int | None = None
    allow_unsafe_domain: bool = False
    pool: str = "default"
    isolation: str = "Domain"
    share_with: tuple[SharedApp, ...] = ()


class Robots(Object, frozen=True, kw_only=True):
    """node_selector: as it is stored, for `matches_labels`."""

    node_selector: dict[str, Any] = {}
    assignment: str = "Each"


class DeviceRequirement(Object, frozen=True, kw_only=True):
    name: str = ""
    type: str = ""
    model: str = ""
    interface: str = ""
    usb_id: str | None = msgspec.field(name="usbID", default=None)
    count: int = 1
    sharing: str = EXCLUSIVE


class Component(Object, frozen=True, kw_only=True):
    name: str
    devices: tuple[DeviceRequirement, ...] = ()
    replicas: int = 1
    replica_identity: str = ""
    ros: str = ""
    job: dict[str, Any] | None = None
    schedule: dict[str, Any] | None = None

    @property
    def ends(self) -> bool:
        """Returns whether its program runs once and ends; one with schedule comes back."""
        return self.job is not None and self.schedule is None

    @property
    def names(self) -> tuple[str, ...]:
        """The names under which it runs and holds devices: its own, or those of its replicas with ordinals."""
        if self.replica_identity != ORDINAL:
            return (self.name,)
        return tuple(replica.name for replica in number_replicas(self.name, self.replicas))


class Ros(Object, frozen=True, kw_only=True):
    version: int | None = None
    distro: str = ""


class Success(Object, frozen=True, kw_only=True):
    operator: str = "All"
    components: tuple[str, ...] = ()


class Completion(Object, frozen=True, kw_only=True):
    success: Success = Success()
    deadline: str | None = None
    max_restarts: int = 0


class AppSpec(Object, frozen=True, kw_only=True):
    suspend: bool = False
    components: tuple[Component, ...] = ()
    ros2: Ros2 | None = None
    robots: Robots | None = None
    matrix: dict[str, Any] | None = None
    ros: Ros | None = None
    completion: Completion | None = None

    def find_component(self, name: str) -> Component | None:
        """Returns the component that runs under this name."""
        return next((component for component in self.components if name in component.names), None)


class App(Object, frozen=True, kw_only=True):
    """A RobotApp."""

    metadata: Meta
    spec: AppSpec = AppSpec()


class TelemetryDevice(Object, frozen=True, kw_only=True):
    """A device a node's agent reports (NodeTelemetry status.devices)."""

    id: str = ""
    type: str = ""
    model: str = ""
    interface: str = ""
    identity: str = ""
    path: str = ""
    present: bool = True
    names: tuple[str, ...] = ()


# Claims of devices that a DRA driver hands over (resource.k8s.io/v1)


class DeviceResult(Object, frozen=True, kw_only=True):
    """One allocated device."""

    request: str = ""
    driver: str = ""
    pool: str = ""
    device: str = ""
    admin_access: bool = False
    """Beside whoever has the device, such as a program that watches it: it takes the device from nobody."""


class DeviceResults(Object, frozen=True, kw_only=True):
    results: tuple[DeviceResult, ...] = ()


class Allocation(Object, frozen=True, kw_only=True):
    devices: DeviceResults = DeviceResults()


class ClaimUser(Object, frozen=True, kw_only=True):
    """Who may use the claim: pods, and for as long as it lives the RobotApp."""

    api_group: str = ""
    resource: str = ""
    name: str = ""
    uid: str = ""


class ResourceClaimStatus(Object, frozen=True, kw_only=True):
    allocation: Allocation | None = None
    reserved_for: tuple[ClaimUser, ...] = ()


class ResourceClaim(Object, frozen=True, kw_only=True):
    """A ResourceClaim; what it requests is read by schedulers alone."""

    metadata: Meta
    status: ResourceClaimStatus = ResourceClaimStatus()


class SliceSpec(Object, frozen=True, kw_only=True):
    driver: str = ""
    node_name: str = ""


class ResourceSlice(Object, frozen=True, kw_only=True):
    """A list of devices that a driver publishes, as far as it shows where the driver runs."""

    metadata: Meta
    spec: SliceSpec = SliceSpec()
