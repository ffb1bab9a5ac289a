"""What the operator observed of a RobotApp as a whole. What it observed of one instance stands in RobotAppInstance."""

from typing import Annotated, ClassVar

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Observed
from robotapp_api.model.conditions import Conditions, initial_conditions
from robotapp_api.model.names import Phase
from robotapp_api.model.scalars import Count, Generation, ShortText, Text, Timestamp

PhaseText = Annotated[str, StringConstraints(max_length=32)]
"""A plain string: old readers must survive phases of a newer operator."""
PairText = Annotated[str, StringConstraints(max_length=16)]
ReadyText = Annotated[str, StringConstraints(max_length=32)]
BudgetText = Annotated[str, StringConstraints(max_length=32)]
Message = Annotated[str, StringConstraints(max_length=1024)]
ReasonText = Annotated[str, StringConstraints(max_length=64)]


class InstanceCounts(Observed):
    """Instances of the app by what they are doing."""

    desired: Count = 0
    """Instances the app should have."""
    ready: Count = 0
    """Instances whose components are all ready."""
    offline: Count = 0
    """Instances whose robot is out of reach for longer than connectivity.grace, or out of sight."""
    completed: Count = 0
    """Instances whose jobs have completed: nothing of them runs any more."""
    failed: Count = 0
    """Instances that cannot run as they are written, or whose jobs have failed."""


class Troubled(Observed):
    """An instance that needs somebody to look at it."""

    instance: ShortText = ""
    """Name of the instance, which is its robot's; empty for an app without robots."""
    reason: ReasonText = ""
    """Word for programs."""
    message: Message = ""
    """What is wrong and what to do."""


class Summary(Observed):
    """Values combined for the columns of kubectl get."""

    ready: ReadyText = ""
    """Ready and desired components, such as 3/3; "3/3 (1 held)" while a template of a newer operator holds an edit back. Of a sweep the
    runs that have completed, such as "37/200 done, 1 failed"."""
    robots: PairText = ""
    """Ready and chosen robots, such as 1/1; a dash without robots."""
    domain: ShortText = ""
    """Domains in use, such as 7 or 7-9."""
    budget: BudgetText = ""
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


class RobotAppStatus(Observed):
    """The observation; only the operator writes it."""

    STORED: ClassVar = frozenset({"phase", "conditions"})

    observed_generation: Generation | None = None
    """Generation of the spec this status is about."""
    phase: PhaseText = Phase.PENDING.value
    """Pending, Placing, Running, Degraded, Offline, Suspended, Stopping, Completed or Failed; more may come."""
    conditions: Conditions = initial_conditions()
    """Ready, Accepted, Allocated, Placed, BudgetMet, Progressing, Stalled."""
    instance_counts: InstanceCounts = InstanceCounts()
    """How many instances there are; kubectl get robotappinstances lists them."""
    troubled: Annotated[tuple[Troubled, ...], Field(max_length=10)] = ()
    """Instances that need somebody to look at them, worst first."""
    summary: Summary = Summary()
    """Combined values for the columns."""
    completion_time: Timestamp | None = None
    """When all instances had ended; spec.completion.ttl counts from then."""
