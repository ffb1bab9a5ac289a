"""Which instances an app has: those of its robots, or those of a sweep."""

from typing import Annotated, Final, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Model
from robotapp_api.model.markers import ListMap, ListSet, MapAtomic, Rule
from robotapp_api.model.scalars import ShortText

Assignment = Literal["Each", "Any"]
LABEL_KEY: Final = "^([a-z0-9]([-a-z0-9.]*[a-z0-9])?/)?[A-Za-z0-9]([-A-Za-z0-9_.]*[A-Za-z0-9])?$"
"""Prefix and name; their lengths are left to whoever reads the label."""
MOST_PARAMETERS: Final = 8
MOST_VALUES: Final = 256
LabelKey = Annotated[str, StringConstraints(min_length=1, max_length=317, pattern=LABEL_KEY)]


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
        Rule(
            rule=f"!has(self.matchLabels) || self.matchLabels.all(key, key.matches('{LABEL_KEY}'))",
            message="a key is no label key; write for example robotics.io/robot",
            path=".matchLabels",
        ),
    )


class Robots(Model):
    """Robots an app runs for. A robot is a node with the label robotics.io/robot; where several nodes carry the same name,
    the one that also has robotics.io/robot-primary: "true" is `@robot`.
    """

    node_selector: Annotated[LabelSelector, MapAtomic()]
    """Chooses robots by the labels of their nodes; must not be empty."""
    assignment: Assignment = "Each"
    """Each runs one instance of the app per chosen robot; Any runs one instance for one of them."""


MatrixValue = Annotated[str, StringConstraints(min_length=1, max_length=128, pattern=r"^[^\x00-\x1f\x7f$]+$")]


class MatrixParameter(Model):
    """One parameter of a sweep, and the values it takes."""

    name: Annotated[str, StringConstraints(min_length=1, max_length=32, pattern="^[a-z][a-z0-9_]*$")]
    """Name of the parameter: speed is $(MATRIX_SPEED) in command, args, env, run, launch and inline parameter files."""
    values: Annotated[tuple[MatrixValue, ...], ListSet(), Field(min_length=1, max_length=MOST_VALUES)]
    """Values, as text without $: numbers in quotes."""


class Matrix(Model):
    """A sweep: one instance of the app for each combination of the values. An instance ends with its components that have `job`."""

    RULES = (
        Rule(
            rule=" * ".join(
                f"(size(self.parameters) > {index} ? size(self.parameters[{index}].values) : 1)"
                for index in range(MOST_PARAMETERS)
            )
            + f" <= {MOST_VALUES}",
            message=f"a sweep has at most {MOST_VALUES} instances, and the values of its parameters have more combinations; write fewer values, or a RobotApp for each part",
            path=".parameters",
        ),
    )

    parameters: Annotated[tuple[MatrixParameter, ...], ListMap("name"), Field(min_length=1, max_length=MOST_PARAMETERS)]
    """Parameters and their values; each combination is an instance, at most 256."""
    parallelism: Annotated[int, Field(ge=1, le=MOST_VALUES)] = 10
    """How many instances run at once; each has a domain of its own while it runs."""
