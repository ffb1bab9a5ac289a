"""References of the pods of an app: objects of its namespace, and texts in which the operator expands the robot's name and ordinals."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.patterns import LABEL_VALUE_PATTERN, SUBDOMAIN_PATTERN
from robotapp_api.values.references import ObjectReference, Values, expand, list_references

_KEY: Final = re.compile(r"[-._a-zA-Z0-9]{1,253}")
_NAME: Final = re.compile(SUBDOMAIN_PATTERN)
_LABEL: Final = re.compile(LABEL_VALUE_PATTERN)
_LONGEST_NAME: Final = 253
_LONGEST_LABEL: Final = 63


class ExpandedText(NamedTuple):
    """A text in which references are expanded. `kind`: name, key, label or path."""

    path: str
    kind: str
    text: str


def list_object_references(component: Component, at: str) -> Iterator[ObjectReference]:
    """Yields the objects that the component names in core's fields, not those of `parameters`. `at`: where it stands."""
    pod = component.template.spec
    yield from list_references(component.env, f"{at}.env")
    yield from list_references(component.env_from, f"{at}.envFrom")
    yield from list_references(pod.volumes, f"{at}.template.spec.volumes")
    for container, where in list_further_containers(component, at):
        yield from list_references(container, where)


def list_further_containers(component: Component, at: str) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yields what runs before and beside the component in its pod, and where each stands."""
    pod = component.template.spec
    for place, containers in (("initContainers", pod.init_containers), ("containers", pod.containers)):
        for index, container in enumerate(containers):
            yield container, f"{at}.template.spec.{place}[{index}]"


def list_expanded_texts(component: Component, at: str) -> Iterator[ExpandedText]:
    """Yields every text of the component in which names of robot and instance, and ordinals, are expanded."""
    for reference in list_object_references(component, at):
        yield ExpandedText(reference.path, "name", reference.name)
        for key in reference.keys:
            yield ExpandedText(f"{reference.path.rpartition('.')[0]}", "key", key)
    pod = component.template.spec
    for index, secret in enumerate(pod.image_pull_secrets):
        yield ExpandedText(f"{at}.template.spec.imagePullSecrets[{index}].name", "name", str(secret.get("name", "")))
    for index, file in enumerate(component.parameters):
        ref = file.config_map_key_ref or file.secret_key_ref
        if ref is not None:
            field = "configMapKeyRef" if file.config_map_key_ref else "secretKeyRef"
            yield ExpandedText(f"{at}.parameters[{index}].{field}.name", "name", ref.name)
            yield ExpandedText(f"{at}.parameters[{index}].{field}.key", "key", ref.key)
    labels = {f"{at}.template": component.template.metadata.labels}
    if component.service is not None:
        labels[f"{at}.service"] = component.service.metadata.labels
    for owner, entries in labels.items():
        for key, value in entries.items():
            yield ExpandedText(f'{owner}.metadata.labels["{key}"]', "label", value)
    mounts: list[tuple[str, Iterable[Mapping[str, Any]]]] = [(f"{at}.volumeMounts", component.volume_mounts)]
    mounts += [
        (f"{where}.volumeMounts", container.get("volumeMounts") or ())
        for container, where in list_further_containers(component, at)
    ]
    for field, items in mounts:
        for index, mount in enumerate(items):
            yield ExpandedText(f"{field}[{index}].subPath", "path", str(mount.get("subPath") or ""))


def list_helper_texts(spec: RobotAppSpec) -> Iterator[ExpandedText]:
    """Yields the same of the pods of discovery servers, router and master."""
    helpers = {"spec.ros1": spec.ros1, "spec.ros2.discovery": spec.ros2.discovery if spec.ros2 else None}
    for at, helper in helpers.items():
        if helper is None or helper.template is None:
            continue
        for key, value in helper.template.metadata.labels.items():
            yield ExpandedText(f'{at}.template.metadata.labels["{key}"]', "label", value)
        for index, secret in enumerate(helper.template.spec.image_pull_secrets):
            place = f"{at}.template.spec.imagePullSecrets[{index}].name"
            yield ExpandedText(place, "name", str(secret.get("name", "")))


def expanded_problem(text: ExpandedText, values: Values) -> str:
    """Returns why the text is not what it must be with these values in it, "" if it is."""
    full_text = expand(text.text, values)
    if text.kind == "name" and not (len(full_text) <= _LONGEST_NAME and _NAME.fullmatch(full_text)):
        return f'"{full_text}" is no name of an object: names have at most {_LONGEST_NAME} lower-case letters, digits, "-" and "."'
    if text.kind == "key" and not _KEY.fullmatch(full_text):
        return f'"{full_text}" is no key: keys have at most {_LONGEST_NAME} letters, digits, "-", "_" and "."'
    if text.kind == "label" and not (len(full_text) <= _LONGEST_LABEL and _LABEL.fullmatch(full_text)):
        return f'"{full_text}" is no value of a label: values have at most {_LONGEST_LABEL} letters, digits, "-", "_" and "."'
    return ""
