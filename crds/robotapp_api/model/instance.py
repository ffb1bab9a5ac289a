"""RobotAppInstance: what the operator observed of one instance of an app. Only restarts of its jobs are counted by it."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model import names
from robotapp_api.model.app.edge import EdgeKind
from robotapp_api.model.app.status import BudgetText, PairText, PhaseText, ReadyText
from robotapp_api.model.base import Model, ObjectMeta, Observed
from robotapp_api.model.conditions import Conditions, initial_conditions
from robotapp_api.model.markers import Column, Kind, ListMap, Rule
from robotapp_api.model.names import Phase
from robotapp_api.model.scalars import AppName, Count, DomainId, Duration, ShortText, Text, Timestamp

BriefMessage = Annotated[str, StringConstraints(max_length=256)]
EdgeText = Annotated[str, StringConstraints(max_length=255)]


class InstanceSpec(Model):
    """Which instance of which app this is."""

    RULES = (
        Rule(
            rule="self == oldSelf",
            message="an instance never becomes another one; the operator deletes this object and creates a new one",
            reason="FieldValueForbidden",
        ),
    )

    app: AppName
    """RobotApp the instance belongs to."""
    app_uid: Annotated[str, StringConstraints(min_length=1, max_length=36), Field(alias="appUID")]
    """Uid of that RobotApp; another app of the same name has other instances."""
    instance: ShortText = ""
    """Name of the instance within the app: that of its robot or of its combination of values; empty for an app with neither."""
    robot: ShortText = ""
    """Robot of the instance; empty for an app without robots."""
    matrix: Annotated[dict[str, Annotated[str, StringConstraints(max_length=128)]], Field(max_length=8)] = Field(
        default_factory=dict
    )
    """Values of the instance by the names of the parameters of the app's matrix; empty without a matrix."""


class ComponentStatus(Observed):
    """One component of an instance."""

    name: ShortText
    """Component."""
    node: Text = ""
    """Node its pod is bound to; empty while it waits."""
    ready: bool = False
    """All its replicas are ready."""
    completed: bool = False
    """Its job has completed."""
    restarts: Count = 0
    """Container restarts of its pods."""
    message: BriefMessage = ""
    """Why it is not ready and what to do."""


class HelperStatus(Observed):
    """A discovery server, router or master of an instance."""

    name: ShortText
    """discovery-0, discovery-1, router or master."""
    image: Text = ""
    """Image its pod runs."""
    node: Text = ""
    """Node its pod is bound to; empty while it waits."""
    ready: bool = False
    """It serves."""
    restarts: Count = 0
    """Container restarts of its pod."""
    message: BriefMessage = ""
    """Why it is not ready and what to do."""


class EdgeStatus(Observed):
    """One edge of an instance."""

    kind: EdgeKind = "Topic"
    """What `topic` names."""
    topic: EdgeText
    """Topic, service or action of the edge."""
    from_: Annotated[ShortText, Field(alias="from")]
    """Component that publishes, or calls the service or action."""
    to: ShortText
    """Component that subscribes, or serves."""
    budget: Duration | None = None
    """Budget of the edge."""
    p95: Duration | None = None
    """Round-trip time between the two nodes, 95th percentile, the worse of both directions. Written anew when the verdict
    changes, or at most once a minute when it has changed by a fifth."""
    measured: bool = False
    """The time was measured for this pair of nodes. True without a p95: no probe was answered, the other end is unreachable.
    False with a p95: both ends are on one node. False without: it is not known."""
    met: bool | None = None
    """The budget holds; absent while unknown."""
    nodes: Annotated[tuple[Text, ...], Field(max_length=2)] = ()
    """Nodes of the two ends."""


class Move(Observed):
    """When a component was moved to another node."""

    component: ShortText
    """Component that moved."""
    times: Annotated[tuple[Timestamp, ...], Field(max_length=4)] = ()
    """Times of its latest moves."""


class InstanceLink(Observed):
    """An address for people."""

    component: ShortText
    """Component that serves it."""
    name: ShortText
    """Name of the link in the component's service."""
    url: Annotated[str, StringConstraints(max_length=1024)]
    """Address for a browser; of a Service of type ClusterIP one that only pods of the cluster reach."""


class InstanceSummary(Observed):
    """Values combined for the columns of kubectl get."""

    ready: ReadyText = ""
    """Ready and desired components, such as 3/3; "3/3 (1 held)" while a template of a newer operator holds an edit back."""
    budget: BudgetText = ""
    """Worst round-trip time and its budget, such as 18/30ms."""
    devices: PairText = ""
    """Held and wanted devices, such as 2/2."""
    nodes: Text = ""
    """Nodes in use, cut to the column."""
    message: BriefMessage = ""
    """What is wrong first, and what to do."""


class Restarts(Observed):
    """Restarts of an instance because a job had failed (completion.maxRestarts)."""

    count: Count = 0
    """How many of completion.maxRestarts are used."""
    attempt: Count = 0
    """Number of the present attempt, which its Jobs have in the annotation robotics.io/attempt. It never becomes smaller."""
    run_hash: ShortText = ""
    """Hash of what its jobs run; with another one the count begins anew."""
    began: Timestamp | None = None
    """Since when completion.deadline counts."""
    message: BriefMessage = ""
    """Why it was started again last."""


class InstanceStatus(Observed):
    """The observation; only the operator writes it."""

    STORED: ClassVar = frozenset({"phase", "conditions"})

    phase: PhaseText = Phase.PENDING.value
    """Phase of the instance, in the words of a RobotApp's phase."""
    conditions: Conditions = initial_conditions()
    """The conditions of a RobotApp, about this instance alone."""
    summary: InstanceSummary = InstanceSummary()
    """Combined values for the columns."""
    domain: DomainId | None = None
    """ROS_DOMAIN_ID the instance holds."""
    components: Annotated[tuple[ComponentStatus, ...], Field(max_length=64)] = ()
    """Components, worst first."""
    helpers: Annotated[tuple[HelperStatus, ...], ListMap("name"), Field(max_length=4)] = ()
    """Pods that the operator added: discovery servers, router or master."""
    links: Annotated[tuple[InstanceLink, ...], ListMap("component", "name"), Field(max_length=32)] = ()
    """Addresses of `service.links` of the components."""
    edges: Annotated[tuple[EdgeStatus, ...], Field(max_length=64)] = ()
    """Edges, worst first."""
    edges_omitted: Count = 0
    """Edges that had no room in the list above."""
    claims: Annotated[tuple[Text, ...], Field(max_length=64)] = ()
    """RobotClaims the instance holds."""
    completion_time: Timestamp | None = None
    """When its jobs had completed or failed."""
    restarts: Restarts | None = None
    """How often it was started again; absent before that. Written before the Jobs are replaced, because for a moment
    there may be none."""
    moves: Annotated[tuple[Move, ...], ListMap("component"), Field(max_length=64)] = ()
    """Components that were moved to another node (placement.reschedule, devices[].onLoss): a copy of what their Deployments say."""


class RobotAppInstance(Model):
    """What runs of one instance of a RobotApp: its components, edges, claims and conditions. The operator writes it, and
    writes it again when it was deleted; only restarts of its jobs are counted by it.
    """

    CRD: ClassVar = Kind(
        plural="robotappinstances",
        singular="robotappinstance",
        short_names=("rai",),
        namespaced=True,
        columns=(
            Column("App", ".spec.app"),
            Column("Robot", ".spec.robot"),
            Column("Ready", ".status.summary.ready"),
            Column("Phase", ".status.phase"),
            Column("Domain", ".status.domain", type="integer"),
            Column("Budget", ".status.summary.budget"),
            Column("Devices", ".status.summary.devices"),
            Column("Nodes", ".status.summary.nodes"),
            Column("Age", ".metadata.creationTimestamp", type="date"),
            Column("Message", ".status.summary.message", wide=True),
        ),
        selectable=(".spec.app", ".spec.appUID", ".spec.robot", ".status.phase"),
    )

    api_version: Literal["robotics.io/v1alpha1"] = names.API_VERSION
    """Version of the schema this object is written in."""
    kind: Literal["RobotAppInstance"] = "RobotAppInstance"
    """Kind of this object."""
    metadata: ObjectMeta = ObjectMeta()
    """Name, namespace, labels and annotations."""
    spec: InstanceSpec
    """Which instance of which app this is; never changes."""
    status: InstanceStatus = InstanceStatus()
    """The observation; only the operator writes it."""
