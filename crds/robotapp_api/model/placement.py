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
    """What happens when no placement fits. Not used yet: the pods wait."""

    steps: Annotated[tuple[FallbackStep, ...], Field(max_length=8)] = ("RelaxPreferred", "Wait")
    """Steps in order: RelaxPreferred drops wishes, Wait keeps the pods pending. On board as a fallback is runsOn: [Edge, Robot]."""
    after: Duration = "10s"
    """Time without a placement before the next step."""


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
    """What placement optimises: Latency keeps edges short, Balance spreads load over the nodes."""
    gang: Gang = "All"
    """All places the components of an instance together or not at all; None places each as soon as it fits."""
    fallback: Fallback = Fallback()
    """What happens when no placement fits."""
    reschedule: Reschedule = Reschedule()
    """When running components may move."""
