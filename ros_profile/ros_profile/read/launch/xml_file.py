"""XML launch files: those of ROS 1 and of ROS 2."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from ros_profile.model.facts import Problem
from ros_profile.model.launch import NOT, Include, LaunchArgument, LaunchFile, StartedNode
from ros_profile.read import xml_text, yaml_text
from ros_profile.read.launch.scope import MAX_NODES, Scope, join

_NODELET_VERBS: Final = ("load", "standalone", "manager")
UNFOLLOWED: Final = {
    "machine": ": write runsOn where it matters on which computer a node runs",
    "unset_env": "",
    "append_env": ": write the variable under env",
    "set_parameter": ": write the parameter for each node",
    "set_parameters_from_file": ": write the parameters for each node",
    "set_use_sim_time": ": write use_sim_time for each node",
    "reset": "",
}
"""Tags that change what is started and are not followed, with what to do about it."""


@dataclass(slots=True)
class _Reading:
    file: str
    arguments: list[LaunchArgument] = field(default_factory=list)
    nodes: list[StartedNode] = field(default_factory=list)
    includes: list[Include] = field(default_factory=list)
    parameters: list[tuple[str, str]] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def children(self, parent: Any, scope: Scope) -> None:
        """Everything of one level; `<remap>` and `<push_ros_namespace>` change what follows them."""
        for element in parent:
            tag = xml_text.tag_of(element)
            if not tag or len(self.nodes) >= MAX_NODES:
                continue
            inner = scope.inner(*_conditions(element))
            if tag == "arg":
                self._argument(element, inner)
            elif tag in ("remap", "set_remap"):
                scope.remaps = (*scope.remaps, _pair(element, "from", "to"))
            elif tag in ("push_ros_namespace", "push-ros-namespace"):
                scope.namespace = join(scope.namespace, xml_text.attribute(element, "namespace"))
            elif tag == "group":
                inner.namespace = join(scope.namespace, xml_text.attribute(element, "ns"))
                self.children(element, inner)
            elif tag == "timer":
                self.children(element, inner)
            elif tag in ("node", "executable", "lifecycle_node"):
                self._node(element, inner, lifecycle=tag == "lifecycle_node")
            elif tag in ("node_container", "load_composable_node"):
                self._container(element, inner, tag)
            elif tag == "include":
                self._include(element, inner)
            elif tag in ("param", "rosparam"):
                self.parameters += _parameters([element])
            elif tag == "let":
                self.arguments.append(_argument(element))
            elif tag in ("set_env", "env"):
                scope.environment = (*scope.environment, _pair(element, "name", "value"))
            elif tag in UNFOLLOWED:
                self._add_problem(element, f"<{tag}> is not followed{UNFOLLOWED[tag]}")

    def _add_problem(self, element: Any, message: str) -> None:
        self.problems.append(Problem(self.file, message, xml_text.line_of(element)))

    def _argument(self, element: Any, scope: Scope) -> None:
        argument = _argument(element)
        if scope.conditions and any(known.name == argument.name for known in self.arguments):
            return
        self.arguments.append(argument)

    def _node(self, element: Any, scope: Scope, *, lifecycle: bool) -> None:
        if element.get("cmd") is not None:
            command = xml_text.attribute(element, "cmd")
            self._add_problem(element, f"a process that is no node gets no component: {command[:200]}")
            return
        if machine := xml_text.attribute(element, "machine"):
            self._add_problem(element, f"machine {machine[:100]} is not followed; write runsOn where it matters")
        arguments = xml_text.attribute(element, "args").split()
        executable = xml_text.attribute(element, "exec", "type")
        package = xml_text.attribute(element, "pkg")
        plugin = container = ""
        if package == "nodelet" and executable == "nodelet" and arguments[:1] and arguments[0] in _NODELET_VERBS:
            plugin = arguments[1] if len(arguments) > 1 and arguments[0] != "manager" else ""
            container = arguments[2] if len(arguments) > 2 and arguments[0] == "load" else ""
            package = plugin.partition("/")[0] or package
            executable = "" if plugin else executable
        self.nodes.append(
            StartedNode(
                package=package,
                executable=executable,
                plugin=plugin,
                name=xml_text.attribute(element, "name"),
                namespace=join(scope.namespace, xml_text.attribute(element, "namespace", "ns")),
                remaps=(*scope.remaps, *_remaps(element)),
                parameters=tuple(_parameters(element)),
                text_parameters=tuple(_text_parameters(element)),
                parameter_files=tuple(_parameter_files(element)),
                environment=(*scope.environment, *_variables(element)),
                prefix=xml_text.attribute(element, "launch-prefix"),
                arguments=tuple(arguments[:50]),
                container=container,
                conditions=scope.conditions,
                lifecycle=lifecycle,
                file=self.file,
                line=xml_text.line_of(element),
            )
        )

    def _container(self, element: Any, scope: Scope, tag: str) -> None:
        name = xml_text.attribute(element, "target", "name")
        if tag == "node_container":
            self._node(element, scope, lifecycle=False)
        namespace = join(scope.namespace, xml_text.attribute(element, "namespace") if tag == "node_container" else "")
        name = join(namespace, name) if tag == "node_container" else name
        for child in element:
            if xml_text.tag_of(child) != "composable_node":
                continue
            own = xml_text.attribute(child, "namespace")
            self.nodes.append(
                StartedNode(
                    package=xml_text.attribute(child, "pkg"),
                    executable="",
                    plugin=xml_text.attribute(child, "plugin"),
                    name=xml_text.attribute(child, "name"),
                    namespace=join(scope.namespace, own) if own else namespace,
                    remaps=(*scope.remaps, *_remaps(child)),
                    parameters=tuple(_parameters(child)),
                    text_parameters=tuple(_text_parameters(child)),
                    parameter_files=tuple(_parameter_files(child)),
                    container=name,
                    conditions=(*scope.conditions, *_conditions(child)),
                    file=self.file,
                    line=xml_text.line_of(child),
                )
            )

    def _include(self, element: Any, scope: Scope) -> None:
        arguments = [_pair(child, "name", "value") for child in element if xml_text.tag_of(child) in ("arg", "let")]
        self.includes.append(
            Include(
                target=xml_text.attribute(element, "file"),
                arguments=tuple(arguments),
                namespace=join(scope.namespace, xml_text.attribute(element, "ns")),
                remaps=scope.remaps,
                conditions=scope.conditions,
                line=xml_text.line_of(element),
                environment=(*scope.environment, *_variables(element)),
            )
        )


def read_launch_xml(data: bytes, file: str) -> LaunchFile:
    """A `.launch` or `.launch.xml` file."""
    root = xml_text.parse(data)
    if isinstance(root, xml_text.Unreadable):
        return LaunchFile(file, "xml", problems=(Problem(file, root.message, root.line),))
    if xml_text.tag_of(root) != "launch":
        return LaunchFile(file, "xml", problems=(Problem(file, "is no launch file: its root is not <launch>", 1),))
    reading = _Reading(file)
    reading.children(root, Scope())
    return LaunchFile(
        file=file,
        format="xml",
        arguments=tuple(reading.arguments),
        nodes=tuple(reading.nodes),
        includes=tuple(reading.includes),
        parameters=tuple(reading.parameters),
        problems=(*_find_slips(data, file), *reading.problems),
    )


def _find_slips(data: bytes, file: str) -> Iterator[Problem]:
    """Yields the first slip of syntax, after which a node may be missing."""
    if slip := xml_text.find_slip(data):
        yield Problem(file, slip.message, slip.line)


def _argument(element: Any) -> LaunchArgument:
    default = element.get("value", element.get("default"))
    return LaunchArgument(
        xml_text.attribute(element, "name"), None if default is None else str(default), xml_text.line_of(element)
    )


def _conditions(element: Any) -> Iterator[str]:
    if (positive := element.get("if")) is not None:
        yield str(positive)
    if (negative := element.get("unless")) is not None:
        yield f"{NOT}{negative}"


def _pair(element: Any, first: str, second: str) -> tuple[str, str]:
    return xml_text.attribute(element, first), xml_text.attribute(element, second)


def _remaps(element: Any) -> Iterator[tuple[str, str]]:
    for child in element:
        if xml_text.tag_of(child) == "remap":
            yield _pair(child, "from", "to")


def _parameters(elements: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    for element in elements:
        tag, name = xml_text.tag_of(element), xml_text.attribute(element, "name", "param")
        if tag == "param" and name:
            if len(element) and element.get("value") is None:
                yield from _parameters(element, f"{prefix}{name}.")
            else:
                yield f"{prefix}{name}", xml_text.attribute(element, "value", "textfile", "command")
        elif tag == "rosparam" and name and element.text:
            yield f"{prefix}{name}", str(element.text).strip()[:1000]
        elif tag == "rosparam" and element.text and element.get("command", "load") == "load":
            yield from _inline(str(element.text))


def _text_parameters(elements: Any, prefix: str = "") -> Iterator[str]:
    """Yields the names of parameters that are stated to be texts."""
    for element in elements:
        if xml_text.tag_of(element) == "param" and (name := xml_text.attribute(element, "name")):
            yield from _text_parameters(element, f"{prefix}{name}.")
            if xml_text.attribute(element, "type") in ("str", "string"):
                yield f"{prefix}{name}"


def _variables(element: Any) -> Iterator[tuple[str, str]]:
    for child in element:
        if xml_text.tag_of(child) == "env":
            yield _pair(child, "name", "value")


def _inline(text: str) -> Iterator[tuple[str, str]]:
    """YAML between <rosparam> and </rosparam>."""
    root, _ = yaml_text.parse(text[:100_000].encode(), "")
    if root is not None and root.kind == "map":
        yield from ((name, node.text) for name, node in yaml_text.scalars(root))


def _parameter_files(element: Any) -> Iterator[str]:
    for child in element:
        tag = xml_text.tag_of(child)
        if tag == "param" and child.get("from"):
            yield xml_text.attribute(child, "from")
        elif tag == "rosparam" and child.get("file"):
            yield xml_text.attribute(child, "file")
