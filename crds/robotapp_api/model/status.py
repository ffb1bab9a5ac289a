"""What the operator observed of a RobotApp: details of the worst instances first, everything else as counts."""

from typing import Annotated, ClassVar

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Observed
from robotapp_api.model.conditions import Conditions, initial_conditions
from robotapp_api.model.markers import ListMap
from robotapp_api.model.names import Phase
from robotapp_api.model.scalars import Count, DomainId, Duration, Generation, ShortText, Text, Timestamp

PhaseText = Annotated[str, StringConstraints(max_length=32)]
"""A plain string: old readers must survive phases of a newer operator."""
PairText = Annotated[str, StringConstraints(max_length=16)]
EdgeText = Annotated[str, StringConstraints(max_length=255)]
Message = Annotated[str, StringConstraints(max_length=1024)]


class ComponentStatus(Observed):
    """One component of an instance."""

    name: ShortText
    """Component."""
    node: Text = ""
    """Node its pod is bound to; empty while it waits."""
    ready: bool = False
    """All its replicas are ready."""
    restarts: Count = 0
    """Container restarts of its pods."""
    message: Message = ""
    """Why it is not ready and what to do."""


class EdgeStatus(Observed):
    """One edge of an instance."""

    topic: EdgeText
    """Topic of the edge."""
    from_: Annotated[ShortText, Field(alias="from")]
    """Publishing end."""
    to: ShortText
    """Subscribing end."""
    budget: Duration | None = None
    """Budget of the edge."""
    p95: Duration | None = None
    """Round-trip time between the two nodes, 95th percentile."""
    measured: bool = False
    """The time was measured for this pair of nodes; otherwise it is estimated or unknown."""
    met: bool | None = None
    """The budget holds; absent while unknown."""
    nodes: Annotated[tuple[Text, ...], Field(max_length=2)] = ()
    """Nodes of the two ends."""


class InstanceStatus(Observed):
    """One instance of the app."""

    STORED: ClassVar = frozenset({"robot"})

    robot: ShortText = ""
    """Robot of the instance; empty for an app without robots."""
    domain: DomainId | None = None
    """ROS_DOMAIN_ID the instance holds."""
    ready: bool = False
    """All components are ready."""
    phase: PhaseText = ""
    """Phase of the instance."""
    components: Annotated[tuple[ComponentStatus, ...], Field(max_length=64)] = ()
    """Components, worst first."""
    edges: Annotated[tuple[EdgeStatus, ...], Field(max_length=64)] = ()
    """Edges, worst first."""
    claims: Annotated[tuple[Text, ...], Field(max_length=64)] = ()
    """RobotClaims the instance holds."""


class Summary(Observed):
    """Values combined for the columns of kubectl get."""

    ready: PairText = ""
    """Ready and desired components, such as 3/3."""
    ready_components: Count = 0
    """Components that are ready, over all instances."""
    desired_components: Count = 0
    """Components wanted, over all instances."""
    robots: PairText = ""
    """Ready and chosen robots, such as 1/1; a dash without robots."""
    domain: ShortText = ""
    """Domains in use, such as 7 or 7-9."""
    budget: Annotated[str, StringConstraints(max_length=32)] = ""
    """Worst round-trip time and its budget, such as 18/30ms."""
    devices: PairText = ""
    """Held and wanted devices, such as 2/2."""
    nodes: Text = ""
    """Nodes in use, cut to the column."""
    rmw: ShortText = ""
    """ROS middleware in use."""
    discovery: Annotated[str, StringConstraints(max_length=32)] = ""
    """Discovery mode in use."""
    message: Text = ""
    """What is wrong first, and what to do."""
    omitted: Count = 0
    """Instances that are only counted, not listed."""


class Moves(Observed):
    """How often a component was moved to another node."""

    STORED: ClassVar = frozenset({"robot"})

    robot: ShortText = ""
    """Robot of the instance."""
    component: ShortText
    """Component that moved."""
    count: Count = 0
    """Moves so far."""
    last: Timestamp | None = None
    """Time of the last move."""


class RobotAppStatus(Observed):
    """The observation; only the operator writes it."""

    STORED: ClassVar = frozenset({"phase", "conditions"})

    observed_generation: Generation | None = None
    """Generation of the spec this status is about."""
    phase: PhaseText = Phase.PENDING.value
    """Pending, Placing, Running, Degraded, Offline, Suspended, Stopping or Failed; more may come."""
    conditions: Conditions = initial_conditions()
    """Ready, Accepted, Allocated, Placed, BudgetMet, Progressing, Stalled."""
    instances: Annotated[tuple[InstanceStatus, ...], ListMap("robot"), Field(max_length=128)] = ()
    """Instances, worst first; summary.omitted counts the rest."""
    summary: Summary = Summary()
    """Combined values for the columns."""
    moves: Annotated[tuple[Moves, ...], ListMap("robot", "component"), Field(max_length=128)] = ()
    """Components that were moved."""
    links: Annotated[dict[str, Message], Field(max_length=8)] = Field(default_factory=dict)
    """Addresses of dashboards and consoles for this app."""
