"""Units of classification: a package, each of its executables with the files it is made of, and well-known nodes by name."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from ros_profile.decide.places import TABLE
from ros_profile.decide.substitution import condition_value, located
from ros_profile.knowledge.interfaces import INTERFACES
from ros_profile.model.endpoints import Endpoint, Role
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.launch import Include, LaunchFile, StartedNode
from ros_profile.model.package import Executable, Manifest, Package, SourceFile, Unit
from ros_profile.read.cpp.types import resolved, ros_name
from ros_profile.read.parameters import text_facts

CODE: Final = frozenset({"cpp", "python"})
"""Languages of what runs in a node."""
OTHERS_WEIGHT: Final = 0.5
IMPORTED_WEIGHT: Final = 0.6
"""What a module imports in its turn is often not used by who imports the module."""
_ARGUMENT: Final = re.compile(r"\$\((?:var|arg) ([\w.-]+)")
_SIGNS = {">": Role.PUBLISHER, "<": Role.SUBSCRIPTION, "?": Role.SERVICE_CLIENT, "!": Role.SERVICE_SERVER}
_KIND = {
    Role.SERVICE_SERVER: "srv",
    Role.SERVICE_CLIENT: "srv",
    Role.ACTION_SERVER: "action",
    Role.ACTION_CLIENT: "action",
}


def package_unit(package: Package) -> Unit:
    """Everything of the package as one. Where it has code, devices that its launch files hand to nodes of other packages
    count by half: those nodes open them.
    """
    has_code = any(source.language in CODE for source in package.sources)
    elsewhere = OTHERS_WEIGHT if has_code else 1.0
    launch_files = (launch for launch in package.launch_files if not is_demonstration(launch))
    facts = tuple(fact for launch in launch_files for fact in _launch_facts(launch, package.name, elsewhere))
    others = _parameter_files_of_others(package) if has_code else set()
    sources = (_weighed(s, OTHERS_WEIGHT) if s.file.rpartition("/")[2] in others else s for s in package.sources)
    return _unit(package, package.name, "package", sources, facts)


def is_demonstration(launch: LaunchFile) -> bool:
    """Returns whether a launch file steers MoveIt's display with a joystick; every generated configuration has one."""
    return any(node.executable.removesuffix(".py") == "moveit_joy" for node in launch.nodes)


def _parameter_files_of_others(package: Package) -> set[str]:
    """Names of parameter files that launch files hand to nodes of other packages only."""
    handed: dict[bool, set[str]] = {True: set(), False: set()}
    for launch in package.launch_files:
        for node in launch.nodes:
            names = {file.rpartition("/")[2] for file in node.parameter_files}
            handed[_is_own(node, package.name)] |= names
    return handed[False] - handed[True]


def _weighed(source: SourceFile, weight: float) -> SourceFile:
    return replace(source, facts=tuple(replace(fact, weight=fact.weight * weight) for fact in source.facts))


def library_unit(package: Package) -> Unit:
    """The code of the package and how it is built: what runs in every process that links it."""
    built = [source for source in package.sources if source.language in (*CODE, "cmake")]
    return _unit(package, package.name, "library", built, ())


def module_units(package: Package) -> Iterator[tuple[str, Unit]]:
    """Yields the modules of Python of a package by dotted name, each with what it imports of the package."""
    by_file = {source.file: source for source in package.sources}
    for file in (name for name, source in by_file.items() if source.language == "python"):
        name = file.removesuffix(".py").removesuffix("/__init__")
        _, inside, below = name.partition(f"{package.name}/")
        dotted = f"{package.name}.{below}".replace("/", ".") if inside else name.rpartition("/")[2]
        others = (by_file[one] for one in closure((file,), by_file) if one != file)
        reached = [by_file[file], *(_weighed(source, IMPORTED_WEIGHT) for source in others)]
        yield dotted, _unit(package, dotted, "library", reached, ())


def executable_unit(package: Package, executable: Executable) -> Unit:
    """An executable with its files and what these include or import within the package. Parameter files of the package
    count for every executable, because which node takes them is decided in launch files.
    """
    by_file = {source.file: source for source in package.sources}
    reached = set(closure(executable.files, by_file))
    sources = [
        s
        for s in package.sources
        if s.file in reached or (s.language == "parameters" and len(package.executables) == 1)
    ]
    return _unit(package, executable.name, executable.kind, sources, ())


def closure(files: Iterable[str], by_file: Mapping[str, SourceFile]) -> list[str]:
    """These files and everything of the package they use, each once."""
    suffixes = _by_suffix(by_file)
    found: dict[str, None] = {}
    waiting = [file for file in files if file in by_file]
    while waiting:
        file = waiting.pop()
        if file in found:
            continue
        found[file] = None
        for used in by_file[file].uses:
            waiting += _resolve(used, file, by_file, suffixes)
    return list(found)


def _by_suffix(by_file: Iterable[str]) -> dict[str, list[str]]:
    """Files by their last path part, for names of which the folder is not known."""
    found: dict[str, list[str]] = {}
    for file in by_file:
        found.setdefault(file.rpartition("/")[2], []).append(file)
    return found


_IMPLEMENTATIONS = (".cpp", ".cc", ".cxx", ".c", ".cu")


def _resolve(
    used: str, user: str, by_file: Mapping[str, SourceFile], suffixes: Mapping[str, list[str]]
) -> Iterator[str]:
    """`pkg/driver.hpp` and its driver.cpp; `pkg.driver` or `.driver` of Python."""
    if by_file[user].language in ("python", "setup"):
        yield from _module(used, user, by_file)
        return
    name = used.rpartition("/")[2]
    for file in suffixes.get(name, ()):
        if f"/{file}".endswith(f"/{used}"):
            yield file
    stem = name.rpartition(".")[0]
    for suffix in _IMPLEMENTATIONS:
        yield from suffixes.get(stem + suffix, ())


def _module(used: str, user: str, by_file: Mapping[str, SourceFile]) -> Iterator[str]:
    dots = len(used) - len(used.lstrip("."))
    folder = user.split("/")[:-1]
    parts = [part for part in used.strip(".").split(".") if part]
    roots = [folder[: len(folder) - dots + 1]] if dots else [[], ["src"], folder]
    for root in roots:
        for length in range(len(parts), 0, -1):
            base = "/".join([*root, *parts[:length]])
            for candidate in (f"{base}.py", f"{base}/__init__.py"):
                if candidate in by_file:
                    yield candidate


def _unit(package: Package, name: str, kind: str, sources: Iterable[SourceFile], more: tuple[Fact, ...]) -> Unit:
    kept = list(sources)
    return Unit(
        package=package.manifest,
        name=name,
        kind=kind,
        facts=(*_dependency_facts(package), *(fact for s in kept for fact in s.facts), *more),
        endpoints=_linked_all((e for s in kept for e in s.endpoints), (f for s in package.sources for f in s.facts)),
        timers=tuple(t for s in kept for t in s.timers),
        parameters=tuple(p for s in kept for p in s.parameters),
        files=tuple(s.file for s in kept),
        languages=frozenset(s.language for s in kept),
        has_launch=bool(package.launch_files),
    )


def _dependency_facts(package: Package) -> Iterator[Fact]:
    manifest = package.manifest
    for dependency in manifest.dependencies:
        build = bool({"build", "build_export", "buildtool"} & set(dependency.kinds))
        run = "exec" in dependency.kinds
        if build or run:
            value = "both" if build and run else "build" if build else "exec"
            yield Fact(Kind.DEPENDENCY, dependency.name, value, manifest.file, dependency.line)
    for export in manifest.exports:
        text = " ".join(f"{key}={value}" for key, value in export.attributes) or export.text
        yield Fact(Kind.EXPORT, export.tag, text, manifest.file, export.line)


def _launch_facts(launch: LaunchFile, package: str, elsewhere: float) -> Iterator[Fact]:
    """What a launch file starts by default, and what its values show of devices. `elsewhere`: weight of values that only
    nodes of other packages take.
    """
    defaults = {argument.name: argument.default or "" for argument in launch.arguments}
    own = [node for node in launch.nodes if _is_own(node, package)]
    inside = [include for include in launch.includes if located(include.target, package)[0] == package]
    taken, given = _passed(own, inside), _passed(launch.nodes, launch.includes)
    used = _passed(
        [node for node in launch.nodes if _weight(node.conditions, defaults)],
        [include for include in launch.includes if _weight(include.conditions, defaults)],
    )
    for node in launch.nodes:
        if weight := _weight(node.conditions, defaults):
            started = node.plugin or f"{node.package}/{node.executable}"
            yield Fact(Kind.STARTS, started, node.name, launch.file, node.line, weight)
        found = [fact for name, value in node.parameters for fact in text_facts(value, launch.file, node.line, name)]
        found += (fact for text in node.arguments for fact in text_facts(text, launch.file, node.line))
        yield from (replace(fact, weight=1.0 if node in own else elsewhere) for fact in found)
    for include in launch.includes:
        if weight := _weight(include.conditions, defaults):
            yield Fact(Kind.STARTS, include.target, "include", launch.file, include.line, weight)
    for argument in launch.arguments:
        weight = elsewhere if argument.name in given and argument.name not in taken else 1.0
        if argument.name in given - used:  # what takes it is not started by default
            weight = 0.0
        for fact in text_facts(argument.default or "", launch.file, argument.line, argument.name):
            yield replace(fact, weight=weight)


def _is_own(node: StartedNode, package: str) -> bool:
    """A node of the package itself; what a nodelet manager or component container loads names the package in its class."""
    loaded = node.package in ("", "nodelet", "rclcpp_components")
    return node.package == package or loaded or node.plugin.startswith(f"{package}/")


def _passed(nodes: Iterable[StartedNode], includes: Iterable[Include]) -> set[str]:
    """Arguments of the launch file that are handed to these."""
    texts = [text for node in nodes for text in (*(value for _, value in node.parameters), *node.arguments)]
    texts += [value for include in includes for _, value in include.arguments]
    return {name for text in texts for name in _ARGUMENT.findall(text)}


def _weight(conditions: Iterable[str], defaults: Mapping[str, str]) -> float:
    """1 when it is started by default, 0 when not, .5 when that cannot be told."""
    verdicts = [condition_value(condition, defaults) for condition in conditions]
    if any(verdict is False for verdict in verdicts):
        return 0.0
    return 0.5 if any(verdict is None for verdict in verdicts) else 1.0


def known_unit(package: str, executable: str, plugin: str) -> Unit | None:
    """A node whose source is not in the workspace, as the table of well-known nodes has it; ROS 1 scripts are named with `.py`."""
    written = INTERFACES.get(plugin) if plugin else INTERFACES.get(f"{package}/{executable.removesuffix('.py')}")
    if written is None:
        return None
    endpoints = []
    for part in written.split(","):
        sign, name, kind = part.split()
        endpoints.append(Endpoint(_SIGNS[sign], name, kind, TABLE, 0))
    return Unit(Manifest(name=package, file=""), plugin or executable, "program", endpoints=tuple(endpoints))


def _linked_all(endpoints: Iterable[Endpoint], facts: Iterable[Fact]) -> tuple[Endpoint, ...]:
    """Endpoints with types in the form `package/msg/Name`, else empty. The type of one in C++ may stand in another file of
    the package: an alias, a callback, a member declared in a header.
    """
    names = {fact.subject: fact.value for fact in facts if fact.kind is Kind.ALIAS}
    return tuple(_linked(endpoint, names) for endpoint in endpoints)


def _linked(endpoint: Endpoint, names: dict[str, str]) -> Endpoint:
    if "/" in endpoint.type or not endpoint.type:
        return endpoint
    written = names.get(endpoint.type, "") if endpoint.type[0] in "&." else endpoint.type
    found = ros_name(resolved(written, names), kind=_KIND.get(endpoint.role, "msg"))
    return replace(endpoint, type=found if "/" in found or "::" in found else "")
