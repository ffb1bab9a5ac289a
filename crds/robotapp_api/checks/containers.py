"""Lists the containers of a component's pod, and finds fields of theirs that would be lost in silence.

Such a field needs another field of the pod, or a newer Kubernetes.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robotapp_api.checks.middleware import FAST_DDS
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.checks.ros import rmw_of, ros_version_of
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec

_STOP_SIGNAL: Final = (
    "needs spec.os of the pod, which RobotApp does not write, so the API server would refuse the pod or drop the field; write "
    "preStop: {exec: {command: [sh, -c, 'kill -INT 1; sleep 10']}}, with which the program has 10 s to end on SIGINT"
)
_UNMASKED: Final = (
    "Unmasked needs a pod with a user namespace of its own, which a RobotApp's pods do not have; leave it out"
)
_TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"
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


def shared_memory_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Says which sidecars do not hear their component over Fast DDS.

    Processes of one pod count as on one host, so Fast DDS 2 sends between them through shared memory alone, whose files
    another user may not open: topics are listed, and no message comes.
    """
    if ros_version_of(spec) == 1 or rmw_of(spec) not in FAST_DDS or (spec.ros2 and spec.ros2.transport == "UDP"):
        return
    for index, component in enumerate(spec.components):
        pod_context: Mapping[str, Any] = component.template.spec.security_context or {}
        (own, _), *steps = list_containers(component, f"spec.components[{index}]")
        for container, where in steps:
            users = [
                (each.get("securityContext") or {}).get("runAsUser", pod_context.get("runAsUser"))
                for each in (own, container)
            ]
            chosen = {str(variable.get("name")) for each in (own, container) for variable in each.get("env") or ()}
            if container.get("restartPolicy") == "Always" and len(set(users)) == 2 and _TRANSPORTS not in chosen:
                mine, other = ("the user of its image" if user is None else f"user {user}" for user in users)
                yield Note(
                    f"{where}.securityContext.runAsUser",
                    f"{component.name} runs as {mine} and {container.get('name')} as {other}: Fast DDS uses shared memory within "
                    "a pod, so they see each other's topics and get no messages; write the same user, or ros2.transport: UDP",
                )


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
