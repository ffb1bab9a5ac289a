"""Is the spec understood? What admission cannot decide becomes `Accepted=False` with the field, the reason and the cure."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from robotapp_api.claims.instances import robot_of
from robotapp_api.model.component import Component
from robotapp_api.model.distros import DISTROS, nearest
from robotapp_api.model.names import ROBOT_END, Annotation, Reason
from robotapp_operator.plan.environment import OURS
from robotapp_operator.plan.instances import allowed_robots, matching_robots
from robotapp_operator.plan.middleware import mode_problem, resolve_mode
from robotapp_operator.plan.objects import Node
from robotapp_operator.plan.wish import App


class Problem(NamedTuple):
    """Why a spec cannot be run: a reason code, the field, and a sentence that says what to write instead."""

    reason: Reason
    field: str
    message: str

    def __str__(self) -> str:
        return f"{self.field}: {self.message}" if self.field else self.message


def problems_of(app: App, nodes: Mapping[str, Node]) -> tuple[Problem, ...]:
    """Every problem of the spec, most basic first; empty means accepted."""
    return (
        *_ros_problems(app),
        *_middleware_problems(app),
        *_component_problems(app),
        *_placement_problems(app, nodes),
    )


def _ros_problems(app: App) -> Iterator[Problem]:
    known = DISTROS.get(app.distro)
    if known is None:
        near = nearest(app.distro)
        cure = f'did you mean "{near}"?' if near else f"known are {', '.join(DISTROS)}"
        yield Problem(Reason.UNKNOWN_DISTRO, "spec.ros.distro", f'"{app.distro}" is no known ROS distribution; {cure}')
    elif app.spec.ros.version not in (None, known.version):
        yield _invalid(
            "spec.ros.version",
            f"{app.distro} is a ROS {known.version} distribution; write version: {known.version} or leave it out",
        )
    if app.ros_version == 1 and app.spec.dds is not None:
        yield _invalid(
            "spec.dds",
            f"{app.distro} is ROS 1, which has a master instead of DDS; remove spec.dds (settings of the master: spec.ros1)",
        )
    if app.ros_version == 2 and app.spec.ros1 is not None:
        yield _invalid(
            "spec.ros1",
            f"{app.distro} is ROS 2, which has no master; remove spec.ros1 (settings of the middleware: spec.dds)",
        )
    if app.ros_version == 1 and app.spec.ros1 and app.spec.ros1.master == "External" and not app.spec.ros1.uri:
        yield _invalid(
            "spec.ros1.uri", "an external master needs its address, for example uri: http://master.example:11311"
        )


def _middleware_problems(app: App) -> Iterator[Problem]:
    if app.ros_version == 1:
        return
    mode = resolve_mode(app.discovery_mode, app.rmw)
    wrong = mode_problem(mode=mode, rmw=app.rmw, distro=app.distro)
    if wrong:
        yield _invalid("spec.dds.discovery.mode", wrong)
    talking = [edge for edge in app.spec.edges if ROBOT_END not in (edge.from_, edge.to) and edge.from_ != edge.to]
    if mode == "Localhost" and talking:
        edge = talking[0]
        yield _invalid(
            "spec.dds.discovery.mode",
            f"Localhost keeps {edge.from_} and {edge.to} apart: every component has its own loopback; write mode: Auto",
        )


def _component_problems(app: App) -> Iterator[Problem]:
    for index, component in enumerate(app.spec.components):
        yield from _resource_problems(index, component)
        for variable in component.env:
            if variable.get("name") in OURS:
                yield _invalid(
                    f"spec.components[{index}].env",
                    f"{variable['name']} of {component.name} is set for all components alike; use {OURS[variable['name']]}",
                )
        if component.params and app.ros_version == 1:
            yield _invalid(
                f"spec.components[{index}].params",
                "ROS 1 has no parameter files for nodes; mount the ConfigMap and load it with rosparam",
            )
        elif component.params and not (component.command or component.args):
            yield _invalid(
                f"spec.components[{index}].params",
                f"the parameter file is passed as an argument, which would replace the image's own command; write command or args of {component.name}",
            )
    yield from _unknown_names(app)
    yield from _contradictions(app)


def _resource_problems(index: int, component: Component) -> Iterator[Problem]:
    """What the API server would refuse in the pod, in the words of its container."""
    limits = component.resources.get("limits") or {}
    for name in component.resources.get("requests") or {}:
        if ("/" in name or name.startswith("hugepages-")) and name not in limits:
            yield _invalid(
                f'spec.components[{index}].resources.requests["{name}"]',
                f"{name} cannot be given to two pods at once, so it needs a limit; write it under limits, the request follows it",
            )


def _unknown_names(app: App) -> Iterator[Problem]:
    names = {component.name for component in app.spec.components}
    for index, component in enumerate(app.spec.components):
        shared = component.shared_data.with_ if component.shared_data else ()
        for field, listed in (
            ("colocateWith", component.colocate_with),
            ("separateFrom", component.separate_from),
            ("sharedData.with", shared),
        ):
            for name in listed:
                if name not in names:
                    yield _invalid(
                        f"spec.components[{index}].{field}",
                        f'"{name}" is no component of this app; components are {", ".join(sorted(names))}',
                    )
    for index, edge in enumerate(app.spec.edges):
        for field, end in (("from", edge.from_), ("to", edge.to)):
            if end not in names and end != ROBOT_END:
                yield _invalid(
                    f"spec.edges[{index}].{field}",
                    f'"{end}" is no component of this app; components are {", ".join(sorted(names))}, the robot itself is {ROBOT_END}',
                )


def _contradictions(app: App) -> Iterator[Problem]:
    """ColocateWith is transitive, so A with B and B with C forbids A separate from C."""
    group = {component.name: component.name for component in app.spec.components}

    def find(name: str) -> str:
        while group[name] != name:
            name = group[name]
        return name

    for component in app.spec.components:
        for name in component.colocate_with:
            if name in group:
                group[find(name)] = find(component.name)
    for index, component in enumerate(app.spec.components):
        for name in component.separate_from:
            if name in group and find(name) == find(component.name):
                yield _invalid(
                    f"spec.components[{index}].separateFrom",
                    f"{component.name} must be apart from {name}, but colocateWith ties both to one node; remove one of the two",
                )


def _placement_problems(app: App, nodes: Mapping[str, Node]) -> Iterator[Problem]:
    master = app.spec.placement.master_node
    if master and master not in nodes:
        yield _invalid("spec.placement.masterNode", f'there is no node "{master}"; kubectl get nodes shows the names')
    if app.spec.robots is None:
        return
    matching = matching_robots(app, nodes)
    if not matching:
        robots = sorted({node.robot for node in nodes.values() if node.robot})
        shown = f"robots are {', '.join(robots[:8])}" if robots else "no node carries the label robotics.io/robot"
        yield Problem(Reason.NO_MATCHING_ROBOT, "spec.robots.selector", f"no robot matches; {shown}")
    elif not allowed_robots(app, nodes):
        node = matching[0]
        allowed = node.annotations.get(Annotation.ALLOWED_NAMESPACES, "")
        yield Problem(
            Reason.NOT_ALLOWED_ON_ROBOT,
            "spec.robots.selector",
            f'robot {robot_of(node)} admits apps of namespace "{allowed}" only (node annotation {Annotation.ALLOWED_NAMESPACES}), this is {app.namespace}',
        )


def _invalid(field: str, message: str) -> Problem:
    return Problem(Reason.INVALID_SPEC, field, message)
