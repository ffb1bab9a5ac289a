"""Finds the guarded fields of a spec: components with all their containers, discovery servers, router and master."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from robotapp_api.checks.host_access.paths import walk_path
from robotapp_api.checks.host_access.table import GUARDED, GuardedField, HostRight, Level, is_free_apparmor
from robotapp_api.checks.problem import Note, Problem
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.app.template import HelperContainer
from robotapp_api.model.names import Reason
from robotapp_api.model.packed import unpacked
from robotapp_api.values.component_references import list_further_containers

_CONTAINER_FIELDS = ("ports", "securityContext", "livenessProbe", "readinessProbe", "startupProbe", "lifecycle")
_NAMES = {
    name: "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name) for name in _CONTAINER_FIELDS
}


class GuardedUse(NamedTuple):
    """A guarded field that a spec sets. `at`: its place, such as `spec.components[0].securityContext.privileged`."""

    at: str
    owner: str
    """Whose pod it is, such as `component driver`."""
    field: GuardedField


class _Pod(NamedTuple):
    """One pod of a spec. containers: by the place where each is written."""

    owner: str
    at: str
    spec: Mapping[str, Any]
    annotations: Mapping[str, str]
    containers: Mapping[str, Mapping[str, Any]]


def find_guarded(spec: RobotAppSpec) -> Iterator[GuardedUse]:
    """Yields every guarded field that is set to a value that is not free for everybody."""
    for pod in _list_pods(spec):
        for field in GUARDED:
            if field.level is Level.ANNOTATIONS:
                for key, value in pod.annotations.items():
                    if not is_free_apparmor(key, value):
                        yield GuardedUse(f'{pod.at}.template.metadata.annotations["{key}"]', pod.owner, field)
                continue
            places = {f"{pod.at}.template.spec": pod.spec} if field.level is Level.POD else pod.containers
            for at, holder in places.items():
                for path, value in walk_path(holder, field.path.split("."), at):
                    if value not in field.free:
                        yield GuardedUse(path, pod.owner, field)


def find_rights(spec: RobotAppSpec) -> dict[HostRight, GuardedUse]:
    """Returns the rights that writing the spec takes, each with the first field that takes it."""
    rights: dict[HostRight, GuardedUse] = {}
    for use in find_guarded(spec):
        rights.setdefault(use.field.right, use)
    return rights


def host_access_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Yields a problem per right for an operator that is not to render such fields."""
    for use in find_rights(spec).values():
        yield Problem(
            Reason.HOST_ACCESS_OFF,
            use.at,
            f"{use.owner} {use.field.effect} ({use.field.name}), and this operator was started without --host-access, so it renders no such "
            "field: leave it out, or ask whoever runs the cluster to install the chart with policies.enabled: true, which brings the flag "
            "and the policy that decides who may write it",
        )


def host_access_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Yields a note per right that writing the spec takes, for who checks a file without a cluster."""
    for use in find_rights(spec).values():
        yield Note(
            use.at,
            f"{use.owner} {use.field.effect}: who applies it needs the verb use on {use.field.right.resource} in the namespace, and the "
            "namespace a Pod Security level that admits it",
        )


def _list_pods(spec: RobotAppSpec) -> Iterator[_Pod]:
    for index, component in enumerate(spec.components):
        yield _read_component(component, f"spec.components[{index}]")
    if spec.ros2 is not None:
        yield _read_helper(spec.ros2.discovery, "ros2.discovery")
    if spec.ros1 is not None:
        yield _read_helper(spec.ros1, "ros1")


def _read_component(component: Component, at: str) -> _Pod:
    template = component.template
    pod = template.spec
    fields = {
        "hostNetwork": pod.host_network,
        "hostIPC": pod.host_ipc,
        "hostPID": pod.host_pid,
        "volumes": pod.volumes.unpack(),
        "securityContext": unpacked(pod.security_context),
    }
    containers: dict[str, Mapping[str, Any]] = {
        at: {name: unpacked(getattr(component, attribute)) for name, attribute in _NAMES.items()}
    }
    containers |= {where: item for item, where in list_further_containers(component, at)}
    return _Pod(f"component {component.name}", at, fields, template.metadata.annotations, containers)


def _read_helper(helper: HelperContainer, name: str) -> _Pod:
    at, template = f"spec.{name}", helper.template
    pod = {"securityContext": unpacked(template.spec.security_context)} if template else {}
    annotations = template.metadata.annotations if template else {}
    return _Pod(name, at, pod, annotations, {at: {"securityContext": unpacked(helper.security_context)}})
