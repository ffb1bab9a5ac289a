"""Which robots an app is for."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Model
from robotapp_api.model.markers import MapAtomic, Rule
from robotapp_api.model.scalars import ShortText

Instances = Literal["Each", "Any"]
LabelKey = Annotated[str, StringConstraints(min_length=1, max_length=317)]


class LabelExpression(Model):
    """One requirement on a node label."""

    key: LabelKey
    """Label key, such as robotics.io/robot."""
    operator: Literal["In", "NotIn", "Exists", "DoesNotExist"]
    """Relation between the label and the values."""
    values: Annotated[tuple[ShortText, ...], Field(max_length=64)] = ()
    """Values for In and NotIn; empty for Exists and DoesNotExist."""

    RULES = (
        Rule(
            rule="self.operator in ['In', 'NotIn'] == (has(self.values) && size(self.values) > 0)",
            message="In and NotIn need values, Exists and DoesNotExist take none",
            path=".values",
        ),
    )


class LabelSelector(Model):
    """Node labels that must all hold."""

    match_labels: Annotated[dict[str, ShortText], Field(max_length=16)] = Field(default_factory=dict)
    """Labels a robot's node must have with exactly these values."""
    match_expressions: Annotated[tuple[LabelExpression, ...], Field(max_length=16)] = ()
    """Further requirements on the labels of a robot's node."""

    RULES = (
        Rule(
            rule="(has(self.matchLabels) && size(self.matchLabels) > 0) || (has(self.matchExpressions) && size(self.matchExpressions) > 0)",
            message="an empty selector would choose every node; write matchLabels, for example robotics.io/robot: amr-07",
        ),
    )


class Robots(Model):
    """Robots an app runs for. A robot is a node with the label robotics.io/robot."""

    selector: Annotated[LabelSelector, MapAtomic()]
    """Chooses robots by the labels of their nodes; must not be empty."""
    instances: Instances = "Each"
    """Each runs one instance of the app per chosen robot; Any runs one instance for one of them."""
