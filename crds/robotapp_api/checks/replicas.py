"""Replicas with ordinals: the spec with each of them as a component of its own, and what keeps it from being one."""

import re
from collections.abc import Iterator
from typing import Final

from pydantic import ValidationError

from robotapp_api.checks.containers import list_containers
from robotapp_api.checks.problem import Problem, invalid
from robotapp_api.checks.size import size_problem
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.base import dump
from robotapp_api.model.names import ORDINAL_VARIABLE
from robotapp_api.values.component_references import list_expanded_texts, list_helper_texts
from robotapp_api.values.replicas import (
    MOST_COMPONENTS,
    MOST_EDGES,
    ORDINAL,
    count_components,
    count_edges,
    expand_replicas,
    is_replica_name,
    list_replicas,
)

_REFERENCE: Final = re.compile(rf"(?<!\$)(?:\$\$)*\$\({ORDINAL_VARIABLE}\)")


def has_ordinals(component: Component) -> bool:
    """Returns whether the component's replicas have names of their own."""
    return component.replica_identity == ORDINAL


def expand_spec(spec: RobotAppSpec) -> RobotAppSpec:
    """Returns the spec with each replica that has an ordinal as a component of its own; one that `replica_problems` refuses as it is."""
    if not any(map(has_ordinals, spec.components)):
        return spec
    body = expand_replicas(dump(spec))
    if size_problem(body):
        return spec
    try:
        return RobotAppSpec.model_validate(body)
    except ValidationError:
        return spec


def replica_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Finds ordinals where there are none, and apps in which replicas cannot have the names that ordinals give them."""
    for index, component in enumerate(spec.components):
        at = f"spec.components[{index}]"
        if has_ordinals(component):
            yield from _name_problems(spec, component, at)
        elif field := next((field for field, text in list_program_texts(component, at) if _REFERENCE.search(text)), ""):
            yield invalid(
                field,
                f"$({ORDINAL_VARIABLE}) of {component.name} would stay as it stands, because its replicas have no ordinals; write "
                f"replicaIdentity: {ORDINAL}, or leave the reference out",
            )
    for text in list_helper_texts(spec):
        if _REFERENCE.search(text.text):
            yield invalid(
                text.path, f"discovery servers, router and master have no ordinal; leave $({ORDINAL_VARIABLE}) out"
            )
    if any(map(has_ordinals, spec.components)):
        yield from _size_problems(spec)


def _name_problems(spec: RobotAppSpec, component: Component, at: str) -> Iterator[Problem]:
    for other in spec.components:
        if is_replica_name(other.name, component.name):
            yield invalid(
                f"{at}.replicaIdentity",
                f"component {other.name} has the name of a replica of {component.name}; give it another name",
            )
    for text in list_expanded_texts(component, at):
        is_shared = text.path.startswith((f"{at}.service.", f"{at}.template.spec.imagePullSecrets"))
        if is_shared and _REFERENCE.search(text.text):
            yield invalid(
                text.path,
                f"all replicas of {component.name} have it in common, so it has no ordinal; leave $({ORDINAL_VARIABLE}) out",
            )
    if component.template.spec.hostname:
        yield invalid(
            f"{at}.template.spec.hostname",
            f"replicas with ordinals have host names of their own, {component.name}-0 and so on; remove hostname",
        )


def _size_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Each replica counts as a component, so the spec with all of them must be one that the schema admits."""
    body = dump(spec)
    replicas = list_replicas(body["components"])
    counts = (
        ("components", count_components(body, replicas), MOST_COMPONENTS),
        ("edges", count_edges(body, replicas), MOST_EDGES),
    )
    too_many = [(field, count, most) for field, count, most in counts if count > most]
    for field, count, most in too_many:
        yield invalid(
            f"spec.{field}",
            f"with each replica that has an ordinal as a component of its own the app has {count} {field}, and at most {most} are "
            f"allowed; write fewer replicas, or leave replicaIdentity: {ORDINAL} out",
        )
    if too_many:
        return
    if too_large := size_problem(expand_replicas(body)):
        text = f"with each replica that has an ordinal as a component of its own: {too_large.message}"
        yield too_large._replace(field="spec.components", message=text)
        return
    try:
        RobotAppSpec.model_validate(expand_replicas(body))
    except ValidationError as error:
        first = error.errors()[0]
        field = [str(part) for part in first["loc"] if not isinstance(part, int)][-1]
        yield invalid(
            "spec.components",
            f"with each replica that has an ordinal as a component of its own, {field} is not allowed: {first['msg']}; write fewer "
            "replicas, or a shorter name",
        )


def list_program_texts(component: Component, at: str) -> Iterator[tuple[str, str]]:
    """Yields the texts in which somebody expands references, the kubelet or the operator, and where each stands."""
    for field in ("run", "launch"):
        if (part := getattr(component, field)) is not None:
            yield f"{at}.{field}", part.model_dump_json()
    for container, where in list_containers(component, at):
        for field in ("command", "args"):
            for word in container.get(field) or ():
                yield f"{where}.{field}", str(word)
        for variable in container.get("env") or ():
            yield f"{where}.env", str(variable.get("value") or "")
        for mount in container.get("volumeMounts") or ():
            yield f"{where}.volumeMounts", str(mount.get("subPathExpr") or "")
    for text in list_expanded_texts(component, at):
        yield text.path, text.text
