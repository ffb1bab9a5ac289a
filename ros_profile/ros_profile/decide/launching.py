"""What a launch file starts when every include is followed and every argument has its default."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from ros_profile.decide.substitution import condition_value, located, resolve
from ros_profile.decide.workspace import Index
from ros_profile.model.facts import Problem
from ros_profile.model.launch import UNKNOWN_TEXT, Include, LaunchFile, StartedNode, shorten_substitutions
from ros_profile.model.package import Package

MAX_DEPTH: Final = 12
MAX_NODES: Final = 500
MAX_INCLUDES: Final = 300


@dataclass(frozen=True, slots=True)
class Launched:
    """A node with every text resolved. `namespace` is absolute; remaps are in the order in which they apply."""

    node: StartedNode
    package: str
    namespace: str
    name: str
    container: str
    """Full name of the container that a composable node is loaded into."""
    remaps: tuple[tuple[str, str], ...]
    parameters: tuple[tuple[str, str], ...]
    parameter_files: tuple[str, ...]
    certain: bool
    file: str
    """`package/path` of the launch file that starts it."""
    values: Mapping[str, str]
    executable: str = ""
    plugin: str = ""
    arguments: tuple[str, ...] = ()
    environment: tuple[tuple[str, str], ...] = ()
    prefix: str = ""

    @property
    def full_name(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"


@dataclass(slots=True)
class Closure:
    nodes: list[Launched] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)
    """Includes of packages that are not in the workspace: `package/file`."""
    problems: list[Problem] = field(default_factory=list)
    followed: int = 0


@dataclass(frozen=True, slots=True)
class _Context:
    """What an including file gives to the included one."""

    values: Mapping[str, str]
    namespace: str = "/"
    remaps: tuple[tuple[str, str], ...] = ()
    environment: tuple[tuple[str, str], ...] = ()
    certain: bool = True
    chain: tuple[str, ...] = ()


def closure(index: Index, package: Package, launch: LaunchFile) -> Closure:
    """The nodes of a launch file and of everything it includes within the workspace."""
    found = Closure()
    _follow(index, package, launch, _Context({}), found)
    found.nodes = _in_their_containers(found.nodes)
    return found


def _in_their_containers(nodes: list[Launched]) -> list[Launched]:
    """Nodes loaded into a container that is named without its namespace get its full name, where one container is called so."""
    started: dict[str, set[str]] = {}
    for node in nodes:
        if not node.plugin:
            started.setdefault(node.name, set()).add(node.full_name)
    placed: list[Launched] = []
    for node in nodes:
        candidates = started.get(node.container.rpartition("/")[2], set())
        is_certain = not node.container or node.container in candidates or len(candidates) != 1
        placed.append(node if is_certain else replace(node, container=next(iter(candidates))))
    return placed


def _follow(index: Index, package: Package, launch: LaunchFile, context: _Context, found: Closure) -> None:
    place = f"{package.name}/{launch.file}"
    found.followed += 1
    if place in context.chain or len(context.chain) >= MAX_DEPTH or found.followed > MAX_INCLUDES:
        found.problems.append(Problem(place, "includes itself or too many files; not followed again"))
        return
    values = _values(launch, context.values)
    for node in launch.nodes:
        if len(found.nodes) >= MAX_NODES:
            found.problems.append(
                Problem(place, f"starts more than {MAX_NODES} nodes; the rest is left out", node.line)
            )
            return
        verdict = _verdict(node.conditions, values)
        if verdict is not False:
            found.nodes.append(_launched(node, package, context, values, certain=context.certain and verdict is True))
    for include in launch.includes:
        verdict = _verdict(include.conditions, values)
        if verdict is not False:
            inner = _inner(include, context, values, place, is_ros1=_is_ros1(package, launch), certain=verdict is True)
            _include(index, package, include, inner, found)


def _values(launch: LaunchFile, given: Mapping[str, str]) -> dict[str, str]:
    """Arguments in the order of the file: given ones stay, others take their default."""
    values = dict(given)
    for argument in launch.arguments:
        if argument.name not in values and argument.default is not None:
            values[argument.name] = resolve(argument.default, values)
    return values


def _verdict(conditions: tuple[str, ...], values: Mapping[str, str]) -> bool | None:
    verdicts = [condition_value(condition, values) for condition in conditions]
    return False if False in verdicts else None if None in verdicts else True


def _is_ros1(package: Package, launch: LaunchFile) -> bool:
    return launch.format == "xml" and package.manifest.ros_version == 1


def _inner(
    include: Include, context: _Context, values: Mapping[str, str], place: str, *, is_ros1: bool, certain: bool
) -> _Context:
    """ROS 1 gives only what is passed; in ROS 2 everything that is set is seen below as well."""
    passed = {name: resolve(value, values) for name, value in include.arguments if name}
    return _Context(
        values=passed if is_ros1 else {**values, **passed},
        namespace=absolute(resolve(include.namespace, values), context.namespace),
        remaps=(*context.remaps, *_resolved(include.remaps, values)),
        environment=(*context.environment, *_resolved(include.environment, values)),
        certain=context.certain and certain,
        chain=(*context.chain, place),
    )


def _include(index: Index, package: Package, include: Include, context: _Context, found: Closure) -> None:
    target = resolve(include.target, context.values)
    holder, path = located(target, package.name)
    known = index.launch_file(holder, path) if path else None
    if known is not None:
        _follow(index, *known, context, found)
    elif holder and holder != package.name and index.package(holder) is None:
        found.outside.append(f"{holder}/{path}")
    else:
        reason = "there is no such launch file"
        if UNKNOWN_TEXT in target:
            reason = "its name is made while the launch file runs"
            target = shorten_substitutions(target[:200])
        elif not holder:
            reason = "it is named by an absolute path, which the source does not have"
        name = f": {target[:200]}" if target else ""
        text = f"an include is not followed, {reason}{name}; import the file that it means, too, or give its nodes components of their own"
        found.problems.append(Problem(context.chain[-1], text, include.line))


def _resolved(pairs: tuple[tuple[str, str], ...], values: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    return tuple((resolve(first, values), resolve(second, values)) for first, second in pairs)


def absolute(name: str, namespace: str) -> str:
    """A namespace or name within a namespace, with one slash between parts and none at the end."""
    joined = name if name.startswith("/") else f"{namespace}/{name}"
    return "/" + "/".join(part for part in joined.split("/") if part)


def _launched(
    node: StartedNode, package: Package, context: _Context, values: Mapping[str, str], *, certain: bool
) -> Launched:
    name = resolve(node.name, values)
    return Launched(
        node=node,
        package=resolve(node.package, values),
        namespace=absolute(resolve(node.namespace, values), context.namespace),
        name=name,
        container=absolute(resolve(node.container, values), context.namespace) if node.container else "",
        remaps=(*context.remaps, *_resolved(node.remaps, values), *_argument_remaps(node.arguments, values)),
        parameters=_resolved(node.parameters, values),
        parameter_files=tuple(_parameter_file(file, values, package.name) for file in node.parameter_files),
        certain=certain,
        file=f"{package.name}/{node.file}",
        values=values,
        executable=resolve(node.executable, values),
        plugin=resolve(node.plugin, values),
        environment=(*context.environment, *_resolved(node.environment, values)),
        prefix=resolve(node.prefix, values),
        arguments=_command_line(node.arguments, values),
    )


def _command_line(arguments: tuple[str, ...], values: Mapping[str, str]) -> tuple[str, ...]:
    """Arguments resolved. XML has them in one text, which was split within `$(arg x)`."""
    if any(text.count("(") != text.count(")") for text in arguments if "$(" in text):
        return tuple(resolve(" ".join(arguments), values).split())
    return tuple(resolve(text, values) for text in arguments)


def _parameter_file(file: str, values: Mapping[str, str], package: str) -> str:
    holder, path = located(resolve(file, values), package)
    return f"{holder}/{path}" if holder else path


def _argument_remaps(arguments: tuple[str, ...], values: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """`a:=b` of command lines; parameters (`_x:=1` of ROS 1) are none."""
    found = []
    for argument in arguments:
        first, mark, second = resolve(argument, values).partition(":=")
        if mark and first and not first.startswith("_"):
            found.append((first, second))
    return tuple(found)
