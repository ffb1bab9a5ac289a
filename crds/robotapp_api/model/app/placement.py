"""Where an app may run as a whole, what happens when nothing fits, and when running components may move."""

from typing import Annotated, Literal

from pydantic import Field

from robotapp_api.model.base import Model
from robotapp_api.model.scalars import Duration, ShortText, Text

Objective = Literal["Latency", "Balance"]
FallbackStep = Literal["RelaxPreferred", "Wait"]
Gang = Literal["All", "None"]
RescheduleWhen = Literal["Never", "BudgetExceeded"]


class Fallback(Model):
    """What happens when no place meets every budget with `enforce: Preferred`. Until then they count as Required."""

    steps: Annotated[tuple[FallbackStep, ...], Field(max_length=8)] = ("RelaxPreferred", "Wait")
    """Steps in order: RelaxPreferred places the pods without the budgets that cannot be met, Wait keeps them pending; without
    RelaxPreferred they wait until all are met. On board as a fallback is runsOn: [Edge, Robot]."""
    after: Duration = "10s"
    """Time that the pods wait before the first step, and before every further one."""


class Reschedule(Model):
    """When a running component may move to another node."""

    when: RescheduleWhen = "Never"
    """Never, or BudgetExceeded: a required edge stays above its budget, and the scheduler knows a better node."""
    for_: Annotated[Duration, Field(alias="for")] = "15s"
    """How long a budget must be exceeded before BudgetMet is False and anything moves, and met before BudgetMet is True again."""
    cooldown: Duration = "2m"
    """Rest between two moves of one component, whatever they are for."""
    max_per_day: Annotated[int, Field(ge=0, le=1000)] = 3
    """Moves of one component within 24 hours, whatever they are for."""


class Placement(Model):
    """Placement of the whole app."""

    zones: Annotated[tuple[ShortText, ...], Field(max_length=16)] = ()
    """Preferred values of topology.kubernetes.io/zone, best first."""
    master_node: Text = ""
    """Node of the ROS 1 master, and the node that latencies of components without edges are counted to; empty means the
    robot's node."""
    objective: Objective = "Latency"
    """What placement optimises within the budgets: Latency keeps edges short, Balance spreads load over the nodes first."""
    gang: Gang = "All"
    """All places the components of an instance together or not at all; None places each as soon as it fits."""
    fallback: Fallback | None = None
    """Places that meet budgets with `enforce: Preferred` come first, for some time. Absent: such a budget only ranks nodes, and no
    pod waits for it."""
    reschedule: Reschedule = Reschedule()
    """When running components may move."""
