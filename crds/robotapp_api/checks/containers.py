"""Lists the containers of a component's pod, and finds fields of theirs that would be lost in silence.

Such a field needs another field of the pod, or a newer Kubernetes.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.component import Component

_STOP_SIGNAL: Final = (
    "needs spec.os of the pod, which RobotApp does not write, so the API server would refuse the pod or drop the field; write "
    "preStop: {exec: {command: [sh, -c, 'kill -INT 1; sleep 10']}}, with which the program has 10 s to end on SIGINT"
)
_UNMASKED: Final = (
    "Unmasked needs a pod with a user namespace of its own, which a RobotApp's pods do not have; leave it out"
)
_SINCE: Final = {"restartPolicyRules": "1.35", "fileKeyRef": "1.35"}
"""Fields that an older API server drops without a word, with the first release that has them on."""


def gated_field_problems(component: Component, at: str) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    for container, where in list_containers(component, at):
        if "stopSignal" in (container.get("lifecycle") or {}):
            yield invalid(f"{where}.lifecycle.stopSignal", _STOP_SIGNAL)
        if (container.get("securityContext") or {}).get("procMount") == "Unmasked":
            yield invalid(f"{where}.securityContext.procMount", _UNMASKED)


def gated_field_notes(component: Component, at: str) -> Iterator[Note]:
    """Says which fields an older cluster stores without acting on them."""
    for container, where in list_containers(component, at):
        if container.get("restartPolicyRules"):
            yield _note_age(f"{where}.restartPolicyRules", "restartPolicyRules")
        for index, variable in enumerate(container.get("env") or ()):
            if (variable.get("valueFrom") or {}).get("fileKeyRef"):
                yield _note_age(f"{where}.env[{index}].valueFrom.fileKeyRef", "fileKeyRef")


def _note_age(field: str, name: str) -> Note:
    return Note(field, f"needs Kubernetes {_SINCE[name]}; an older API server drops it without a word")


def list_containers(component: Component, at: str) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yields the component's own container and its init containers, with core's names, and where each stands."""
    own = {
        "name": component.name,
        "command": component.command,
        "args": component.args,
        "envFrom": component.env_from,
        "lifecycle": component.lifecycle,
        "securityContext": component.security_context,
        "env": component.env,
    }
    yield own, at
    for index, container in enumerate(component.template.spec.init_containers):
        yield container, f"{at}.template.spec.initContainers[{index}]"
