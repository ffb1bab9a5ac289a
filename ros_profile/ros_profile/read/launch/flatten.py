"""The actions of a launch description as plain lists, with what groups give to everything in them."""

from dataclasses import dataclass, field, replace
from typing import Any, Final

from ros_profile.model.facts import Problem
from ros_profile.model.launch import Include, LaunchArgument, StartedNode
from ros_profile.read.launch import python_values as v
from ros_profile.read.launch.scope import MAX_NODES, Scope, join

MAX_DEPTH: Final = 60


@dataclass(slots=True)
class Flattened:
    """Actions by kind: groups give namespaces, remaps, variables and conditions to what stands in them."""

    file: str
    arguments: list[LaunchArgument] = field(default_factory=list)
    nodes: list[StartedNode] = field(default_factory=list)
    includes: list[Include] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def actions(self, listed: list[Any], scope: Scope, depth: int = 0) -> None:
        for action in listed if depth < MAX_DEPTH else []:
            if len(self.nodes) + len(self.includes) >= MAX_NODES:
                return
            if isinstance(action, list):
                self.actions(action, scope, depth + 1)
            elif isinstance(action, v.Group):
                inner = scope.inner(*action.conditions)
                self.actions(action.actions, inner, depth + 1)
                if not action.scoped:
                    scope.namespace, scope.remaps, scope.environment = inner.namespace, inner.remaps, inner.environment
            elif isinstance(action, v.Push):
                scope.namespace = join(scope.namespace, action.namespace)
            elif isinstance(action, v.Remap):
                scope.remaps = (*scope.remaps, action.pair)
            elif isinstance(action, v.Environment):
                scope.environment = (*scope.environment, action.pair)
            elif isinstance(action, v.Unknown | v.Unfollowed):
                self._add_problem(action)
            else:
                self._leaf(action, scope)

    def _add_problem(self, action: v.Unknown | v.Unfollowed) -> None:
        if isinstance(action, v.Unfollowed):
            message = action.message
        elif action.call:
            message = f"what {action.call}(…) starts is not followed: it is defined elsewhere; give its nodes components of their own"
        else:
            message = "an action is not followed: it is known only while the launch file runs"
        problem = Problem(self.file, message, action.line)
        if problem not in self.problems:
            self.problems.append(problem)

    def _leaf(self, action: Any, scope: Scope) -> None:
        if isinstance(action, LaunchArgument):
            self.arguments.append(action)
        elif isinstance(action, StartedNode):
            self.nodes.append(_in_scope(action, scope))
        elif isinstance(action, Include):
            conditions = (*scope.conditions, *action.conditions)
            self.includes.append(
                replace(
                    action,
                    namespace=scope.namespace,
                    remaps=scope.remaps,
                    conditions=conditions,
                    environment=scope.environment,
                )
            )
        elif isinstance(action, v.Container):
            inner = scope.inner(*action.conditions)
            name = action.name
            if action.node is not None:
                container = _in_scope(action.node, scope)
                self.nodes.append(container)
                name = join(container.namespace, name)
            for loaded in action.loaded:
                self.nodes.append(replace(_in_scope(loaded, inner), container=name))


def _in_scope(node: StartedNode, scope: Scope) -> StartedNode:
    return replace(
        node,
        namespace=join(scope.namespace, node.namespace),
        remaps=(*scope.remaps, *node.remaps),
        conditions=(*scope.conditions, *node.conditions),
        environment=(*scope.environment, *node.environment),
    )
