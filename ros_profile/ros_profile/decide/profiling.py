"""From packages to a profile: units are judged, launch files followed, edges matched."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from ros_profile.decide.classify import is_bringup, only_assets, runs_code
from ros_profile.decide.classify.features import name_roles
from ros_profile.decide.control import runs_control, with_control_hardware
from ros_profile.decide.edges import Ends, edges, ends_of, file_parameters
from ros_profile.decide.engines import Engine
from ros_profile.decide.launching import Launched, closure
from ros_profile.decide.places import abroad, placed
from ros_profile.decide.transport import network_setting
from ros_profile.decide.units import executable_unit, is_demonstration, package_unit
from ros_profile.decide.workspace import Index
from ros_profile.model.conclusions import (
    Assessment,
    ExecutableProfile,
    GraphName,
    LaunchedNode,
    LaunchProfile,
    PackageProfile,
    Profile,
    QosClass,
)
from ros_profile.model.endpoints import Parameter
from ros_profile.model.facts import NOT_HERE, Problem
from ros_profile.model.launch import LaunchFile
from ros_profile.model.package import Executable, Manifest, Package, Unit
from ros_profile.read.parameters import text_facts

SURE = 0.8
MANY_OTHERS = 1.5
"""So many programs of other packages for each of its own make a package with code a bring-up."""
_CONTROL_NODE_NAME = "/controller_manager"
"""What the control node of ros2_control calls itself, whatever its program is called."""


def profile(
    packages: Iterable[Package],
    engine: Engine,
    *,
    path: str,
    curated: bool = True,
    problems: tuple[Problem, ...] = (),
) -> Profile:
    """The profile of everything that was read. `curated=False`: without edges of well-known nodes."""
    index = Index(packages, curated=curated)
    engine = replace(engine, classify=_remembering(engine))
    return Profile(
        path=path,
        engine=engine.name,
        packages=tuple(_package(package, engine, index) for package in index.packages),
        problems=problems,
    )


def _remembering(engine: Engine) -> Callable[[Unit], Assessment]:
    """Launch files include each other: what they start is judged once."""
    judged: dict[tuple[object, ...], Assessment] = {}

    def classify(unit: Unit) -> Assessment:
        key = (unit.package.name, unit.name, unit.kind, unit.parameters, unit.files, len(unit.facts))
        if key not in judged:
            judged[key] = engine.classify(unit)
        return judged[key]

    return classify


def _package(package: Package, engine: Engine, index: Index) -> PackageProfile:
    """A package with code is judged by its code; one that only launches by what it starts."""
    executables = tuple(_executable(package, executable, engine) for executable in package.executables)
    launches = tuple(_launch(package, launch, engine, index) for launch in package.launch_files)
    demonstrations = {launch.file for launch in package.launch_files if is_demonstration(launch)}
    unit = package_unit(package)
    own = placed(engine.classify(unit), of=package.name, within=package.name)
    own = _timed_by_its_programs(own, [executable.assessment for executable in executables])
    if engine.follows_launch_files and not _is_no_program(unit, own):
        own = _with_launches(own, [one for one in launches if one.file not in demonstrations], unit, engine)
    return PackageProfile(
        name=package.name,
        path=package.path,
        ros_version=package.manifest.ros_version,
        assessment=own,
        executables=executables,
        launches=launches,
        problems=package.problems,
    )


def _with_launches(assessment: Assessment, launches: Sequence[LaunchProfile], unit: Unit, engine: Engine) -> Assessment:
    """Returns a package that only starts others as all of what it starts. Where its code is a helper of what it starts,
    it has the class of that, and its own hardware.
    """
    if not launches:
        return assessment
    started = engine.aggregate([assessment, *(launch.assessment for launch in launches)])
    if not runs_code(unit) or is_bringup(unit.package.name):
        return started
    if (
        assessment.qos_class is None
        or assessment.qos_class.value is QosClass.BEST_EFFORT
        or assessment.qos_class.confidence >= SURE
        or not _starts_others(launches, unit.package.name)
    ):
        return assessment
    return replace(
        started,
        hardware=assessment.hardware,
        hardware_confidence=assessment.hardware_confidence,
        doubted=assessment.doubted,
    )


def _starts_others(launches: Iterable[LaunchProfile], package: str) -> bool:
    """Returns whether launch files start more programs of other packages than of this one."""
    programs = {(node.package, node.executable, node.plugin) for launch in launches for node in launch.nodes}
    own = sum(name == package or plugin.startswith(f"{package}::") for name, _, plugin in programs)
    return len(programs) > MANY_OTHERS * max(own, 1)


def _timed_by_its_programs(assessment: Assessment, programs: Sequence[Assessment]) -> Assessment:
    """The package's times are those of its programs of the same class: timers and rates of others say nothing of them."""
    qos = assessment.qos_class
    same = [a for a in programs if a.qos_class and qos and a.qos_class.value is qos.value]
    from_source = [a for a in same if a.deadline_s is not None and a.deadline_s.evidence]
    timed = [a.deadline_s for a in from_source or same if a.deadline_s is not None]
    if not timed:
        return assessment
    tightest = min(timed, key=lambda estimate: estimate.value)
    lead = next(a for a in from_source or same if a.deadline_s is tightest)
    return replace(assessment, sub_class=lead.sub_class, deadline_s=tightest, latency_budget_s=lead.latency_budget_s)


def _is_no_program(unit: Unit, assessment: Assessment) -> bool:
    """A robot description or a simulation whose launch files only show it."""
    if name_roles(unit.package.name)[:1] == ("simulation",) or only_assets(unit):
        return True
    qos = assessment.qos_class
    is_sure = qos is not None and qos.value is QosClass.BEST_EFFORT and qos.confidence >= SURE
    return is_sure and not is_bringup(unit.package.name)


def _executable(package: Package, executable: Executable, engine: Engine) -> ExecutableProfile:
    unit = executable_unit(package, executable)
    return ExecutableProfile(
        name=executable.name,
        kind=executable.kind,
        plugin=executable.plugin,
        assessment=placed(engine.classify(unit), of=package.name, within=package.name),
        graph=tuple(GraphName(e.role.value, e.name, e.type, e.qos, e.file, e.line) for e in unit.endpoints),
    )


def _launch(package: Package, launch: LaunchFile, engine: Engine, index: Index) -> LaunchProfile:
    found = closure(index, package, launch)
    ends: list[Ends] = []
    nodes: list[LaunchedNode] = []
    for launched in found.nodes:
        unit = index.unit(launched.package, launched.executable, launched.plugin)
        end = ends_of(launched, unit, index)
        ends.append(end)
        name = _CONTROL_NODE_NAME if runs_control(launched) else end.full_name
        of_files = tuple(file_parameters(launched, name, index))
        started = _as_launched(launched, unit, of_files)
        if runs_control(launched):
            started = with_control_hardware(started, launched, index)
        judged = placed(engine.classify(started), of=started.package.name, within=package.name)
        values = {p.name: p.default for p in of_files} | dict(launched.parameters)
        nodes.append(replace(_node(end, judged), network=network_setting(values.items())))
    absent = dict.fromkeys(name.partition("/")[0] for name in found.outside)
    included = [engine.classify(Unit(Manifest(name=name, file=""), name, "launch")) for name in absent]
    outside = tuple(Problem(launch.file, f"includes {name}{NOT_HERE}") for name in found.outside)
    return LaunchProfile(
        package=package.name,
        file=launch.file,
        nodes=tuple(nodes),
        edges=edges(ends),
        assessment=_of_all(nodes, included, engine),
        problems=(*launch.problems, *found.problems, *outside),
        parameter_texts=tuple(_parameter_texts(nodes, index)),
    )


def _parameter_texts(nodes: Iterable[LaunchedNode], index: Index) -> Iterator[tuple[str, str]]:
    """Yields the parameter files of these nodes that ROS 2 reads as they stand in the workspace."""
    for file in dict.fromkeys(file for node in nodes for file in node.parameter_files):
        package, _, path = file.partition("/")
        source = index.parameter_file(package, path)
        if source is not None and source.text:
            yield file, source.text


def _of_all(nodes: Sequence[LaunchedNode], included: Sequence[Assessment], engine: Engine) -> Assessment:
    """Of what is started by default; where that has no class, of everything that may be started."""
    sure = engine.aggregate([*(node.assessment for node in nodes if node.certain), *included])
    return sure if sure.qos_class else engine.aggregate([*(node.assessment for node in nodes), *included])


def _node(end: Ends, assessment: Assessment) -> LaunchedNode:
    launched = end.launched
    return LaunchedNode(
        full_name=end.full_name,
        package=launched.package,
        executable=launched.executable,
        plugin=launched.plugin,
        container=launched.container,
        assessment=assessment,
        graph=end.graph,
        certain=launched.certain,
        parameter_files=launched.parameter_files,
        remaps=launched.remaps,
        parameters=launched.parameters,
        namespace=launched.namespace,
        file=launched.file,
        line=launched.node.line,
        arguments=() if launched.plugin else launched.arguments,
        text_parameters=launched.node.text_parameters,
        environment=launched.environment,
        prefix=launched.prefix,
    )


def _as_launched(launched: Launched, unit: Unit | None, of_files: tuple[Parameter, ...]) -> Unit:
    """The unit with what the launch file gives to it; by its name alone when its source is not there."""
    package, _, path = launched.file.partition("/")
    file, line = abroad(package, path), launched.node.line
    known = unit or Unit(
        package=Manifest(name=launched.package, file=""),
        name=launched.plugin or launched.executable,
        kind="component" if launched.plugin else "program",
    )
    stated = tuple(Parameter(name, value, file, line) for name, value in launched.parameters)
    names = {parameter.name for parameter in stated}
    rates = (p for p in of_files if p.name not in names)
    given = (*stated, *(replace(p, file=_seen_from(package, p.file)) for p in rates))
    facts = tuple(fact for name, value in launched.parameters for fact in text_facts(value, file, line, name))
    facts += tuple(fact for text in launched.node.arguments for fact in text_facts(text, file, line))
    return replace(known, parameters=(*given, *_others(known, given)), facts=(*known.facts, *facts))


def _seen_from(package: str, file: str) -> str:
    """Returns `package/path` as it is shown in a profile of a package."""
    holder, _, path = file.partition("/")
    return path if holder == package else abroad(holder, path)


def _others(unit: Unit, given: tuple[Parameter, ...]) -> Iterator[Parameter]:
    """Parameters that the launch file does not set."""
    names = {parameter.name for parameter in given}
    return (parameter for parameter in unit.parameters if parameter.name not in names)
