"""Units of classification: a package, and each of its executables with the files it is made of."""

from collections.abc import Iterable, Iterator, Mapping

from ros_profile.decide.linking import linked
from ros_profile.model.facts import Fact, Kind
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import Executable, Package, SourceFile, Unit
from ros_profile.read.parameters import text_facts


def package_unit(package: Package) -> Unit:
    """Everything of the package as one."""
    return _unit(package, package.name, "package", package.sources, tuple(_launch_facts(package.launch_files)))


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
        endpoints=linked((e for s in kept for e in s.endpoints), (f for s in package.sources for f in s.facts)),
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


def _launch_facts(launch_files: Iterable[LaunchFile]) -> Iterator[Fact]:
    """What launch files start by default, and what their values show of devices."""
    for launch in launch_files:
        defaults = {argument.name: argument.default or "" for argument in launch.arguments}
        for node in launch.nodes:
            started = node.plugin or f"{node.package}/{node.executable}"
            weight = _weight(node.conditions, defaults)
            if weight:
                yield Fact(Kind.STARTS, started, node.name, launch.file, node.line, weight)
            for name, value in node.parameters:
                yield from text_facts(value, launch.file, node.line, name)
            for text in node.arguments:
                yield from text_facts(text, launch.file, node.line)
        for include in launch.includes:
            weight = _weight(include.conditions, defaults)
            if weight:
                yield Fact(Kind.STARTS, include.target, "include", launch.file, include.line, weight)
        for argument in launch.arguments:
            yield from text_facts(argument.default or "", launch.file, argument.line, argument.name)


def _weight(conditions: Iterable[str], defaults: Mapping[str, str]) -> float:
    """1 when it is started by default, 0 when not, .5 when that cannot be told."""
    from ros_profile.decide.substitution import condition_value

    verdicts = [condition_value(condition, defaults) for condition in conditions]
    if any(verdict is False for verdict in verdicts):
        return 0.0
    return 0.5 if any(verdict is None for verdict in verdicts) else 1.0
