"""The operator's view of the shared rule which instances an app has: nodes come from its cache."""

from collections.abc import Collection, Mapping

from robotapp_api.model.base import dump
from robotapp_claims.rules import instances as rule
from robotapp_claims.rules.instances import Instance, RobotSelection
from robotapp_claims.rules.objects import Meta
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import Node


def instances_of(
    app: App,
    nodes: Mapping[str, Node],
    *,
    running: Collection[str],
    claimed: Collection[str],
    kept: Collection[str] = (),
) -> tuple[Instance, ...]:
    """Instances in name order. running: instance keys of the app's Deployments, claimed: of its claims.

    kept: robots out of sight whose instances go on.
    """
    selection = robot_selection_of(app)
    metas = [node.metadata for node in nodes.values()] if selection.node_selector is not None else []
    unreachable = {name for name, node in nodes.items() if not node.ready} if selection.assignment == rule.ANY else ()
    return rule.instances_of(selection, metas, running=running, claimed=claimed, unreachable=unreachable, kept=kept)


def matching_robots(app: App, nodes: Mapping[str, Node]) -> list[Meta]:
    """Robot nodes the selector names, in name order, allowed or not."""
    return rule.matching_robots(robot_selection_of(app), (node.metadata for node in nodes.values()))


def allowed_robots(app: App, nodes: Mapping[str, Node]) -> list[Meta]:
    """Matching robots that admit the app's namespace."""
    return rule.allowed_robots(robot_selection_of(app), (node.metadata for node in nodes.values()))


def open_robots(app: App, nodes: Mapping[str, Node]) -> list[Meta]:
    """Nodes of all robots that admit the app's namespace, whatever the app selects."""
    return rule.open_robots((node.metadata for node in nodes.values()), app.namespace)


def robot_selection_of(app: App) -> RobotSelection:
    robots = app.spec.robots
    if app.spec.matrix is not None:
        return RobotSelection(app.uid, app.namespace, combinations=tuple(app.sweep))
    if robots is None:
        return RobotSelection(app.uid, app.namespace)
    return RobotSelection(app.uid, app.namespace, dump(robots.node_selector), robots.assignment)
