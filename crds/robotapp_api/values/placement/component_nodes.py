"""Which nodes a component's pods may use by its tiers and robot: node requirements and tolerations, as core writes them.

One rule for the operator, which writes them into pod templates, and for the scheduler, which tries an app that is not applied.
"""

from collections.abc import Sequence
from typing import Any

from robotapp_api.model.names import Label
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_api.values.selector import NAME_FIELD

Requirements = list[dict[str, Any]]


def tier_terms(runs_on: Sequence[str], robot: str) -> list[Requirements]:
    """Node requirements of which one list must hold, [] for any node. `Robot` means the instance's own robot.

    Which of the tiers is preferred is the scheduler's business.
    """
    if runs_on:
        own = [[is_in(Label.ROBOT, robot)]] if robot and ROBOT in runs_on else []
        labels = [tier.lower() for tier in runs_on if not (own and tier == ROBOT)]
        return [*own, *([[is_in(Label.TIER, *labels)]] if labels else [])]
    if robot:
        # Anywhere, but never on another robot.
        return [[is_in(Label.ROBOT, robot)], [{"key": Label.ROBOT.value, "operator": "DoesNotExist"}]]
    return []


def may_be_on_robot(runs_on: Sequence[str], robot: str) -> bool:
    """Whether pods of the component may run on a robot."""
    return ROBOT in runs_on or bool(robot and not runs_on)


def robot_tolerations(robot: str) -> Requirements:
    """Robots are kept free of other work by a taint whose key is one of their labels."""
    own = {"operator": "Equal", "value": robot} if robot else {"operator": "Exists"}
    return [
        {"key": Label.ROBOT.value, **own},
        {"key": Label.TIER.value, "operator": "Equal", "value": "robot"},
    ]


def required_nodes(terms: Sequence[Requirements]) -> dict[str, Any]:
    """Node affinity: one of `terms`, each a list of requirements that must all hold."""
    return {
        "requiredDuringSchedulingIgnoredDuringExecution": {
            "nodeSelectorTerms": [{"matchExpressions": term} for term in terms]
        }
    }


def require_node(name: str) -> dict[str, Any]:
    """Returns the node affinity of exactly this node.

    The label kubernetes.io/hostname may differ from a node's name, or be missing: clouds and hand-made nodes do so.
    """
    field = {"key": NAME_FIELD, "operator": "In", "values": [name]}
    return {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": [{"matchFields": [field]}]}}


def is_in(key: str, *values: str) -> dict[str, Any]:
    """The node's label has one of these values."""
    return {"key": str(key), "operator": "In", "values": list(values)}
