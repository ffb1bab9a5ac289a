"""Checks of a whole spec that the API server cannot make: what is wrong, most basic first, and what has no effect yet; also of a DomainPool."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from robotapp_api.checks.command_line import expanded_text_problems, node_name_notes, robot_reference_problems
from robotapp_api.checks.components import component_notes, component_problems
from robotapp_api.checks.containers import different_user_notes
from robotapp_api.checks.discovery_variables import variable_notes
from robotapp_api.checks.edges import edge_notes, edge_problems
from robotapp_api.checks.host_access.network import host_name_problems, host_network_notes, is_reachable_by_loopback
from robotapp_api.checks.middleware import FAST_DDS, KNOWN, external_problem, mode_problem
from robotapp_api.checks.parameters import MOST_APP_INLINE_BYTES, inline_bytes
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.checks.recordings.problems import recording_notes, recording_problems
from robotapp_api.checks.replicas import replica_problems
from robotapp_api.checks.ros import discovery_of, rmw_of, ros_components, ros_version_of, uses_ros
from robotapp_api.checks.schedules.problems import schedule_notes, schedule_problems
from robotapp_api.checks.sweeps.problems import sweep_problems
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.override import ComponentOverride
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.distros import DISTROS, NO_DISTRO, NO_ROS, nearest
from robotapp_api.model.names import INSTANCE_VARIABLE, ROBOT_END, ROBOT_VARIABLE, Reason
from robotapp_api.model.pool import DEFAULT_PARTICIPANTS
from robotapp_api.values.component_references import list_expanded_texts, list_helper_texts
from robotapp_api.values.label_key import value_problem
from robotapp_api.values.overrides import merge_component
from robotapp_api.values.placement.neighbours import NO_NEIGHBOURS, NeighbourRules, Neighbours, neighbours
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_api.values.quantities.duration import parse_ns
from robotapp_api.values.references import unknown_reference

_SHORTEST_TTL_NS: Final = 10_000_000_000
"""In less time nobody reads a log."""


def spec_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Every problem that needs no look at the cluster; none means that the spec is understood."""
    yield from _ros_problems(spec)
    yield from _middleware_problems(spec)
    for index, component in enumerate(spec.components):
        version = ros_version_of(spec) if uses_ros(component, spec.ros.distro) else NO_ROS
        yield from component_problems(component, f"spec.components[{index}]", ros_version=version)
    yield from host_name_problems(spec)
    yield from _inline_files(spec)
    yield from expanded_text_problems(list_helper_texts(spec))
    yield from _references_without_robot(spec)
    yield from _override_problems(spec)
    yield from replica_problems(spec)
    yield from _unknown_names(spec)
    yield from _dependency_problems(spec)
    yield from _contradictions(spec)
    yield from _values_of_no_label(spec)
    yield from edge_problems(spec.edges)
    yield from recording_problems(spec)
    yield from sweep_problems(spec)
    yield from schedule_problems(spec)


def spec_notes(spec: RobotAppSpec, *, our_scheduler: bool = True) -> Iterator[Note]:
    """Fields that are stored and understood but have no effect yet, as far as they are not left at their defaults.

    our_scheduler: it places the pods, so that what it does is noted.
    """
    preferred = any(edge.latency is not None and edge.latency.enforce == "Preferred" for edge in spec.edges)
    if spec.placement.fallback is not None and not preferred:
        yield Note("spec.placement.fallback", "changes nothing: no edge has a budget with enforce: Preferred")
    onboard = [component.name for component in spec.components if ROBOT in component.runs_on]
    if spec.robots is None and onboard:
        yield Note(
            "spec.robots", f"is not written, so {onboard[0]} runs on any robot; write which robots the app is for"
        )
    if ros_version_of(spec) == 2 and rmw_of(spec) not in KNOWN:
        yield Note(
            "spec.ros2.rmw",
            f"{rmw_of(spec)} is not known, so discovery is left to it; known are {', '.join(sorted(KNOWN))}",
        )
    if spec.ros2 and spec.ros2.transport == "UDP" and rmw_of(spec) not in FAST_DDS:
        yield Note("spec.ros2.transport", f"UDP changes nothing for {rmw_of(spec)}; it is for Fast DDS")
    if spec.ros2 and spec.ros2.transport == "SHM":
        yield Note("spec.ros2.transport", "SHM has no effect yet; pods of one node do not share memory")
    if spec.ros2 is not None and not ros_components(spec):
        yield Note("spec.ros2", "has no effect: no component uses ROS (ros: None), so the app takes no domain")
    yield from _completion_notes(spec)
    yield from schedule_notes(spec)
    if our_scheduler:
        yield from edge_notes(spec.edges)
    for index, component in enumerate(spec.components):
        yield from component_notes(component, f"spec.components[{index}]")
        if uses_ros(component, spec.ros.distro):
            yield from node_name_notes(component, f"spec.components[{index}]", ros_version=ros_version_of(spec))
    yield from variable_notes(spec)
    yield from host_network_notes(spec)
    yield from different_user_notes(spec)
    yield from recording_notes(spec)


def _completion_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Yields that the app is deleted at once, and that no job is left that could end an instance, because those that count are suspended."""
    ttl = spec.completion.ttl if spec.completion is not None else None
    if ttl is not None and _is_short(ttl):
        yield Note(
            "spec.completion.ttl",
            f"{ttl} after its end the app is deleted with its Jobs and their logs, before anybody has read them; write for example 1h",
        )
    jobs = [component for component in spec.components if component.ends]
    if spec.completion is not None and spec.completion.success.components:
        jobs = [component for component in jobs if component.name in spec.completion.success.components]
    ends = spec.completion is not None or spec.matrix is not None
    if ends and jobs and not any(job.replicas for job in jobs):
        names = ", ".join(job.name for job in jobs)
        field = "spec.completion" if spec.completion is not None else "spec.matrix"
        yield Note(
            field, f"ends no instance: the jobs that count ({names}) are suspended; write replicas: 1 in one of them"
        )


def _is_short(ttl: str) -> bool:
    try:
        return parse_ns(ttl) < _SHORTEST_TTL_NS
    except ValueError:  # more than 292 years
        return False


def _ros_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    distro = spec.ros.distro
    known = DISTROS.get(distro)
    if distro == NO_DISTRO:
        yield from _settings_without_ros(spec)
        return
    if known is None:
        near = nearest(distro)
        cure = f'did you mean "{near}"?' if near else f"known are {', '.join(DISTROS)}"
        yield Problem(Reason.UNKNOWN_DISTRO, "spec.ros.distro", f'"{distro}" is no known ROS distribution; {cure}')
    elif spec.ros.version not in (None, known.version):
        yield invalid(
            "spec.ros.version",
            f"{distro} is a ROS {known.version} distribution; write version: {known.version} or leave it out",
        )
    version = known.version if known else ros_version_of(spec)
    if version == 1 and spec.ros2 is not None:
        yield invalid(
            "spec.ros2",
            f"{distro} is ROS 1, which has a master instead of DDS; remove spec.ros2 (settings of the master: spec.ros1)",
        )
    if version == 2 and spec.ros1 is not None:
        yield invalid(
            "spec.ros1",
            f"{distro} is ROS 2, which has no master; remove spec.ros1 (settings of the middleware: spec.ros2)",
        )
    if ros_version_of(spec) == 1 and spec.ros1 and spec.ros1.master == "External" and not spec.ros1.uri:
        yield invalid(
            "spec.ros1.uri", "an external master needs its address, for example uri: http://master.example:11311"
        )


def _settings_without_ros(spec: RobotAppSpec) -> Iterator[Problem]:
    """Settings of ROS in an app that has none: ros.distro is none."""
    for field, value in (("ros2", spec.ros2), ("ros1", spec.ros1), ("ros.version", spec.ros.version)):
        if value is not None:
            yield invalid(
                f"spec.{field}", f"an app with ros.distro: {NO_DISTRO} has no ROS; remove it, or write the distribution"
            )


def _middleware_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    if ros_version_of(spec) != 2:
        return
    mode = discovery_of(spec)
    wrong = mode_problem(mode=mode, rmw=rmw_of(spec), distro=spec.ros.distro)
    if wrong:
        yield invalid("spec.ros2.discovery.mode", wrong)
    if spec.ros2 and spec.ros2.external and (reason := external_problem(mode)):
        yield invalid("spec.ros2.external", reason)
    components = {component.name: component for component in ros_components(spec)}
    talking = [
        edge
        for edge in spec.edges
        if {edge.from_, edge.to} <= components.keys()
        and edge.from_ != edge.to
        and not _share_a_loopback(components.get(edge.from_), components.get(edge.to))
    ]
    if mode == "Localhost" and talking:
        edge = talking[0]
        yield invalid(
            "spec.ros2.discovery.mode",
            f"Localhost keeps {edge.from_} and {edge.to} apart: every component has its own loopback; write mode: Auto",
        )


def _share_a_loopback(first: Component | None, second: Component | None) -> bool:
    """Decides whether two components are always in the network of one node."""
    if first is None or second is None or not is_reachable_by_loopback(first, second):
        return False
    return second.name in first.colocate_with or first.name in second.colocate_with


def _inline_files(spec: RobotAppSpec) -> Iterator[Problem]:
    """All inline files are read whenever a spec is: an app has to leave time for others."""
    total = sum(map(inline_bytes, spec.components))
    total += sum(
        len((file.inline or "").encode())
        for item in spec.overrides
        for part in item.components
        for file in part.parameters
    )
    if total > MOST_APP_INLINE_BYTES:
        yield invalid(
            "spec.components",
            f"inline parameter files of one app may have {MOST_APP_INLINE_BYTES >> 10} KiB together, these have {total >> 10}; write some of them into a ConfigMap",
        )


def pool_notes(*, max_participants_per_host: int) -> Iterator[Note]:
    """Fields of a DomainPool that are stored and have no effect yet, unless they have their default."""
    if max_participants_per_host != DEFAULT_PARTICIPANTS:
        text = f"{max_participants_per_host} has no effect yet; no pod is refused because of it"
        yield Note("spec.maxParticipantsPerHost", text)


def _references_without_robot(spec: RobotAppSpec) -> Iterator[Problem]:
    """Names of robots in texts that the operator expands, in an app that has none."""
    if spec.robots is not None:
        return
    names = (ROBOT_VARIABLE,) if spec.matrix else (ROBOT_VARIABLE, INSTANCE_VARIABLE)
    texts = [*list_helper_texts(spec)]
    for index, component in enumerate(spec.components):
        texts += list_expanded_texts(component, f"spec.components[{index}]")
        yield from robot_reference_problems(component, f"spec.components[{index}]", names=names)
    for text in texts:
        names_robot = any(f"$({name})" in text.text for name in names)
        if names_robot and not unknown_reference(text.text):
            yield invalid(
                text.path,
                f"{text.kind} {text.text} names the robot, but the app has none; write spec.robots, or the {text.kind} as it is",
            )


def _override_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """What is wrong with overrides, and with the components as each of them makes them."""
    if spec.overrides and spec.robots is None:
        yield invalid(
            "spec.overrides",
            "overrides are for some of the app's robots, and the app has none; write spec.robots, or the values in the components",
        )
    parts: dict[str, list[tuple[str, ComponentOverride]]] = {component.name: [] for component in spec.components}
    for index, override in enumerate(spec.overrides):
        for position, part in enumerate(override.components):
            at = f"spec.overrides[{index}].components[{position}]"
            if part.name in parts:
                parts[part.name].append((at, part))
            else:
                yield invalid(
                    f"{at}.name",
                    f'"{part.name}" is no component of this app; components are {", ".join(sorted(parts))}',
                )
    for component in spec.components:
        yield from _problems_of_overridden(spec, component, parts[component.name])


def _problems_of_overridden(
    spec: RobotAppSpec, component: Component, parts: Sequence[tuple[str, ComponentOverride]]
) -> Iterator[Problem]:
    """Component by component, whose files are parsed once: a large app in many overrides would hold the operator up for seconds."""
    if not parts:
        return
    version = ros_version_of(spec) if uses_ros(component, spec.ros.distro) else NO_ROS
    before = {problem.message for problem in component_problems(component, "", ros_version=version)}
    for at, part in parts:
        for problem in component_problems(merge_component(component, part), at, ros_version=version):
            if problem.message not in before:
                yield problem


def _unknown_names(spec: RobotAppSpec) -> Iterator[Problem]:
    names = {component.name for component in spec.components}
    listed_names = ", ".join(sorted(names))
    for index, component in enumerate(spec.components):
        shared = component.shared_data.with_ if component.shared_data else ()
        for field, listed in (
            ("colocateWith", component.colocate_with),
            ("separateFrom", component.separate_from),
            ("sharedData.with", shared),
        ):
            for name in listed:
                if name not in names:
                    yield invalid(
                        f"spec.components[{index}].{field}",
                        f'"{name}" is no component of this app; components are {listed_names}',
                    )
    for index, edge in enumerate(spec.edges):
        for field, end in (("from", edge.from_), ("to", edge.to)):
            if end not in names and end != ROBOT_END:
                yield invalid(
                    f"spec.edges[{index}].{field}",
                    f'"{end}" is no component of this app; components are {listed_names}, the robot itself is {ROBOT_END}',
                )


def _dependency_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Every component that waits for one that does not exist, and the first circle of components that wait for each other."""
    names = {component.name for component in spec.components}
    for index, component in enumerate(spec.components):
        for dependency in component.depends_on:
            if dependency.component not in names:
                yield invalid(
                    f"spec.components[{index}].dependsOn",
                    f'"{dependency.component}" is no component of this app; components are {", ".join(sorted(names))}',
                )
    circle = find_circle({part.name: [each.component for each in part.depends_on] for part in spec.components})
    if circle:
        index = next(index for index, component in enumerate(spec.components) if component.name == circle[0])
        yield invalid(
            f"spec.components[{index}].dependsOn",
            f"{' waits for '.join([*circle, circle[0]])}, so none of them would ever be created; remove one of these names",
        )


def find_circle(dependencies: Mapping[str, Sequence[str]]) -> list[str]:
    """Returns the names of a circle, each waiting for the next and the last for the first; [] without any."""
    finished: set[str] = set()
    for start in dependencies:
        path: list[str] = []
        open_names: list[Iterator[str]] = [iter((start,))]
        while open_names:
            name = next(open_names[-1], None)
            if name is None:
                open_names.pop()
                if path:
                    finished.add(path.pop())
            elif name in path:
                return path[path.index(name) :]
            elif name not in finished:
                path.append(name)
                open_names.append(iter(dependencies.get(name, ())))
    return []


def _contradictions(spec: RobotAppSpec) -> Iterator[Problem]:
    """Sharing a node is transitive: A with B and B with C forbids A separate from C."""
    found = neighbours_of(spec)
    for index, component in enumerate(spec.components):
        for name in component.separate_from:
            if name in found.get(component.name, NO_NEIGHBOURS).together:
                yield invalid(
                    f"spec.components[{index}].separateFrom",
                    f"{component.name} must be apart from {name}, but colocateWith or sharedData.with ties both to one node; remove one of the names",
                )


def _values_of_no_label(spec: RobotAppSpec) -> Iterator[Problem]:
    """Of a selector of robots: no node can have them, so the app would wait for ever."""
    if spec.robots is None:
        return
    selector, at = spec.robots.node_selector, "spec.robots.nodeSelector"
    values = [(f'{at}.matchLabels["{key}"]', value) for key, value in selector.match_labels.items()]
    for index, expression in enumerate(selector.match_expressions):
        if expression.operator == "In":
            values += [(f"{at}.matchExpressions[{index}].values", value) for value in expression.values]
    for field, value in values:
        if problem := value_problem(value):
            yield invalid(field, f"{problem}; several robots are matchExpressions with operator In")


def neighbours_of(spec: RobotAppSpec) -> Mapping[str, Neighbours]:
    """Which components share a node, and which must not."""
    return neighbours(
        NeighbourRules(
            each.name, (*each.colocate_with, *(each.shared_data.with_ if each.shared_data else ())), each.separate_from
        )
        for each in spec.components
    )
