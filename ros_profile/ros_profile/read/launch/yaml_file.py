"""YAML launch files of ROS 2: the same elements as in XML, as mappings."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from ros_profile.model.facts import Problem
from ros_profile.model.launch import NOT, Include, LaunchArgument, LaunchFile, StartedNode
from ros_profile.read import yaml_text
from ros_profile.read.launch.scope import MAX_NODES, Scope, join
from ros_profile.read.launch.xml_file import UNFOLLOWED
from ros_profile.read.yaml_text import Node


@dataclass(slots=True)
class _Reading:
    file: str
    arguments: list[LaunchArgument] = field(default_factory=list)
    nodes: list[StartedNode] = field(default_factory=list)
    includes: list[Include] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def actions(self, listed: Iterable[Node], scope: Scope) -> None:
        for action in listed:
            for key, line, body in action.items():
                self._action(key, line, body, scope)

    def _action(self, key: str, line: int, body: Node, scope: Scope) -> None:
        inner = scope.inner(*_conditions(body))
        if key in ("arg", "let"):
            default = body.get("default") or body.get("value")
            self.arguments.append(LaunchArgument(_text(body, "name"), default.text if default else None, line))
        elif key in ("push_ros_namespace", "push-ros-namespace"):
            scope.namespace = join(scope.namespace, _text(body, "namespace"))
        elif key in ("set_remap", "remap"):
            scope.remaps = (*scope.remaps, (_text(body, "from"), _text(body, "to")))
        elif key in ("set_env", "env"):
            scope.environment = (*scope.environment, (_text(body, "name"), _text(body, "value")))
        elif key == "group":
            self.actions(body.elements() or _children(body), inner)
        elif key == "timer":
            self.actions(_listed(body, "children"), inner)
        elif key == "include":
            pairs = tuple((_text(one, "name"), _text(one, "value")) for one in _listed(body, "arg", "let"))
            self.includes.append(
                Include(
                    _text(body, "file"), pairs, scope.namespace, scope.remaps, inner.conditions, line, scope.environment
                )
            )
        elif key == "executable":
            message = f"a process that is no node gets no component: {_text(body, 'cmd')[:200]}"
            self.problems.append(Problem(self.file, message, line))
        elif key in UNFOLLOWED:
            self.problems.append(Problem(self.file, f"{key} is not followed{UNFOLLOWED[key]}", line))
        elif key in ("node", "lifecycle_node", "node_container", "load_composable_node"):
            self._node(key, line, body, inner)

    def _node(self, key: str, line: int, body: Node, scope: Scope) -> None:
        name = _text(body, "name")
        namespace = join(scope.namespace, _text(body, "namespace"))
        if key != "load_composable_node":
            self._add(body, line, scope, namespace=namespace, container="", lifecycle=key == "lifecycle_node")
        container = join(namespace, name) if key == "node_container" else _text(body, "target")
        for child in _listed(body, "composable_node"):
            own = join(scope.namespace, _text(child, "namespace")) if child.get("namespace") else namespace
            inner = scope.inner(*_conditions(child))
            self._add(child, child.line, inner, namespace=own, container=container)

    def _add(
        self, body: Node, line: int, scope: Scope, *, namespace: str, container: str, lifecycle: bool = False
    ) -> None:
        if len(self.nodes) >= MAX_NODES:
            return
        self.nodes.append(
            StartedNode(
                package=_text(body, "pkg"),
                executable=_text(body, "exec"),
                plugin=_text(body, "plugin"),
                name=_text(body, "name"),
                namespace=namespace,
                remaps=(*scope.remaps, *((_text(one, "from"), _text(one, "to")) for one in _listed(body, "remap"))),
                parameters=tuple((name, value.text) for name, value in _parameters(_listed(body, "param"))),
                text_parameters=tuple(name for name, value in _parameters(_listed(body, "param")) if value.quoted),
                environment=(
                    *scope.environment,
                    *((_text(one, "name"), _text(one, "value")) for one in _listed(body, "env")),
                ),
                prefix=_text(body, "launch-prefix"),
                parameter_files=tuple(one.text for p in _listed(body, "param") if (one := p.get("from"))),
                arguments=tuple(_text(body, "args").split()[:50]),
                container=container,
                conditions=scope.conditions,
                lifecycle=lifecycle,
                file=self.file,
                line=line,
            )
        )


def read_launch_yaml(data: bytes, file: str) -> LaunchFile:
    """A `.launch.yaml` file."""
    root, problems = yaml_text.parse(data, file)
    actions = root.get("launch") if root is not None else None
    if actions is None:
        return LaunchFile(file, "yaml", problems=(*problems, Problem(file, "is no launch file: it has no key launch")))
    reading = _Reading(file)
    reading.actions(actions.elements(), Scope())
    return LaunchFile(
        file,
        "yaml",
        tuple(reading.arguments),
        tuple(reading.nodes),
        tuple(reading.includes),
        problems=(*problems, *reading.problems),
    )


def _text(node: Node, key: str) -> str:
    found = node.get(key)
    return found.text.strip() if found is not None else ""


def _conditions(body: Node) -> Iterator[str]:
    if positive := body.get("if"):
        yield positive.text
    if negative := body.get("unless"):
        yield f"{NOT}{negative.text}"


def _listed(body: Node, *keys: str) -> Iterator[Node]:
    for key in keys:
        found = body.get(key)
        if found is not None:
            yield from found.elements() or [found]


def _children(body: Node) -> list[Node]:
    """A group written as a mapping: each key is an action."""
    return [
        Node([(key, line, child)], line, "map")
        for key, line, child in body.items()
        if key not in ("if", "unless", "scoped")
    ]


def _parameters(listed: Iterable[Node], prefix: str = "") -> Iterator[tuple[str, Node]]:
    for one in listed:
        name, value = _text(one, "name"), one.get("value")
        if name and value is not None:
            yield f"{prefix}{name}", value
        elif name and one.get("param"):
            yield from _parameters(_listed(one, "param"), f"{prefix}{name}.")
