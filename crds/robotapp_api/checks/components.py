"""Checks of one component: environment, resources, devices, template."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from pydantic.alias_generators import to_snake

from robotapp_api.checks.command_line import command_line_notes, command_line_problems, program_problems
from robotapp_api.checks.containers import (
    gated_field_notes,
    gated_field_problems,
    list_containers,
    pod_problems,
    shared_memory_notes,
)
from robotapp_api.checks.device_names import device_name_notes, device_problems
from robotapp_api.checks.host_access.network import host_pod_notes, host_pod_problems
from robotapp_api.checks.parameters import parameter_problems
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robots import LABEL_KEY
from robotapp_api.model.distros import NO_ROS
from robotapp_api.values.label_key import key_problem, value_problem
from robotapp_api.values.quantities.quantity import parse_milli

SET_FOR_ALL: Final = {
    "ROS_DOMAIN_ID": "spec.ros2.domain",
    "RMW_IMPLEMENTATION": "spec.ros2.rmw",
    "ROS_MASTER_URI": "spec.ros1",
}
"""Variables a component may not set itself, and the field that does it for all components alike."""
RESERVED_PREFIX: Final = "ROBOTAPP_"


def component_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    yield from _resource_problems(component, at)
    yield from _environment_problems(component, at, ros_version=ros_version)
    yield from program_problems(component, at, ros_version=ros_version)
    yield from parameter_problems(component, at, ros_version=ros_version)
    yield from command_line_problems(component, at)
    yield from gated_field_problems(component, at)
    yield from device_problems(component, at)
    yield from _ready_problems(component, at, ros_version=ros_version)
    yield from pod_problems(component, at)
    yield from host_pod_problems(component, at)
    yield from _label_problems(component, at)
    yield from _service_problems(component, at)


def component_notes(component: Component, at: str) -> Iterator[Note]:
    """What of the component has no effect yet, or another one than its author may expect."""
    for index, device in enumerate(component.devices):
        where = f"{at}.devices[{index}]"
        if device.sharing == "Namespace":
            yield Note(f"{where}.sharing", "Namespace acts as Cluster: nothing keeps other namespaces from the device")
        if device.on_loss != "Keep" and (device.sharing != "Exclusive" or device.type == "gpu"):
            yield Note(f"{where}.onLoss", f"{device.on_loss} has no effect: nothing is claimed, so no loss is seen")
    yield from device_name_notes(component.devices, f"{at}.devices")
    yield from device_name_notes(component.requires, f"{at}.requires")
    yield from command_line_notes(component, at)
    yield from gated_field_notes(component, at)
    yield from host_pod_notes(component, at)
    yield from shared_memory_notes(component, at)
    for field in ("durability", "queueSize", "tcpNodelay"):
        if getattr(component.policies, to_snake(field)) is not None:
            yield Note(f"{at}.policies.{field}", "has no effect: the program's own setting counts")


def _resource_problems(component: Component, at: str) -> Iterator[Problem]:
    """What the API server would refuse in the pod, in the words of its container."""
    limits = component.resources.get("limits") or {}
    for name, requested in (component.resources.get("requests") or {}).items():
        if ("/" in name or name.startswith("hugepages-")) and name not in limits:
            yield invalid(
                f'{at}.resources.requests["{name}"]',
                f"{name} cannot be given to two pods at once, so it needs a limit; write it under limits, the request follows it",
            )
        elif name in limits and _is_more(requested, limits[name]):
            yield invalid(
                f'{at}.resources.requests["{name}"]',
                f"{requested} is more than the limit {limits[name]}; write at most as much, or a higher limit",
            )


def _is_more(requested: str | int, limit: str | int) -> bool:
    """False also for what is no quantity, which others refuse."""
    try:
        return parse_milli(requested) > parse_milli(limit)
    except ValueError:
        return False


def _environment_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    for container, where in list_containers(component, at):
        name = container.get("name", "")
        yield from _variable_problems(container.get("env") or (), f"{where}.env", of=name, ros_version=ros_version)


def _variable_problems(
    variables: Iterable[Mapping[str, Any]], field: str, *, of: str, ros_version: int
) -> Iterator[Problem]:
    for variable in variables:
        name = variable.get("name", "")
        if name in SET_FOR_ALL and ros_version == NO_ROS:
            yield invalid(
                field, f"{name} of {of} is for ROS, which the component does without; remove it, or ros: None"
            )
        elif name in SET_FOR_ALL:
            yield invalid(field, f"{name} of {of} is set for all components alike; use {SET_FOR_ALL[name]}")
        elif name.startswith(RESERVED_PREFIX):
            yield invalid(field, f"{name} of {of}: {RESERVED_PREFIX}… belongs to the operator; write another name")


def _label_problems(component: Component, at: str) -> Iterator[Problem]:
    """Labels and annotations of pods and Service that the schema lets through, which leaves out lengths, and for which the API server refuses them."""
    owners = {"template": component.template.metadata}
    if component.service is not None:
        owners["service"] = component.service.metadata
    for owner, metadata in owners.items():
        for field, keys in (("labels", metadata.labels), ("annotations", metadata.annotations)):
            for key in keys:
                if re.fullmatch(LABEL_KEY, key) and (problem := key_problem(key)):
                    yield invalid(f"{at}.{owner}.metadata.{field}", problem)
    for key, value in component.template.spec.node_selector.items():
        if problem := key_problem(key) or value_problem(value):
            yield invalid(f"{at}.template.spec.nodeSelector", problem)


def _service_problems(component: Component, at: str) -> Iterator[Problem]:
    """Finds ports of the Service that lead to no container: the cluster would give them no address, and say nothing."""
    if component.service is None:
        return
    names = {
        (str(port.get("name", "")), str(port.get("protocol") or "TCP"))
        for container, _ in list_containers(component, at)
        for port in container.get("ports") or ()
    }
    for index, port in enumerate(component.service.spec.ports):
        if isinstance(port.target_port, str) and (port.target_port, port.protocol) not in names:
            yield invalid(
                f"{at}.service.spec.ports[{index}].targetPort",
                f"no container of {component.name} has a {port.protocol} port named {port.target_port}; name one under ports, or write "
                "its number",
            )


def _ready_problems(component: Component, at: str, *, ros_version: int) -> Iterator[Problem]:
    ready = component.ready
    if ready is None:
        return
    if ros_version == NO_ROS:
        yield invalid(f"{at}.ready", "asks ROS, which the component does without; write readinessProbe")
        return
    if ready.lifecycle and ros_version == 1:
        yield invalid(f"{at}.ready.lifecycle", "ROS 1 has no lifecycle nodes; write ready.topic or readinessProbe")
    if ready.topic and ready.topic.min_rate is not None and not _is_rate(ready.topic.min_rate):
        yield invalid(f"{at}.ready.topic.minRate", f'{ready.topic.min_rate} is no rate; write for example 20 or "0.5"')


def _is_rate(quantity: str | int) -> bool:
    try:
        return parse_milli(quantity) > 0
    except ValueError:
        return False
