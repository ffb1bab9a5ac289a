"""The component that a recording becomes: operator and scheduler treat it as every other one. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.distros import HELPER_USER, RECORDER_IMAGE
from robotapp_api.model.packed import unpacked
from robotapp_api.model.recording import Recording
from robotapp_api.values.quantities.duration import parse_us
from robotapp_api.values.quantities.quantity import parse_bytes

FOLDER: Final = "/bags"
VOLUME: Final = "robotapp-bags"
PROGRAM: Final = ("python3", "-m", "robotapp_recorder")
RESOURCES: Final[Mapping[str, Any]] = {
    "requests": {"cpu": "100m", "memory": "128Mi"},
    "limits": {"cpu": "1", "memory": "1Gi"},
}
_RESTRICTED: Final[Mapping[str, Any]] = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "seccompProfile": {"type": "RuntimeDefault"},
}
"""What Pod Security `restricted` asks of a container, beside `runAsNonRoot`."""


def add_recorders(spec: RobotAppSpec, *, image: str = RECORDER_IMAGE, user: int = HELPER_USER) -> RobotAppSpec:
    """Returns the spec with a component for each recording; image and user are settings of the operator.

    One that cannot be made is left out: `recording_problems` names what is wrong with it.
    """
    if not spec.recordings:
        return spec
    image = image.replace("{distro}", spec.ros.distro)
    recorders: list[Component] = []
    for recording in spec.recordings:
        with suppress(ValueError):
            recorders.append(_make_component(recording, spec, image=image, user=user))
    return spec.model_copy(update={"components": (*spec.components, *recorders)})


def folder_of(app: str, instance: str, recording: str) -> str:
    """Returns the folder of a recording's bags in its container."""
    return "/".join(part for part in (FOLDER, app, instance, recording) if part)


def _make_component(recording: Recording, spec: RobotAppSpec, *, image: str, user: int) -> Component:
    claim = recording.volume.claim_name if recording.volume else ""
    fields: dict[str, Any] = {
        "name": recording.name,
        "image": recording.image or image,
        "imagePullPolicy": recording.image_pull_policy,
        "args": [*PROGRAM, "record", *_list_arguments(recording)],
        "env": [{"name": "HOME", "value": "/tmp"}, {"name": "ROS_LOG_DIR", "value": "/tmp/ros"}],  # noqa: S108 - within the container
        "volumeMounts": [{"name": VOLUME, "mountPath": FOLDER}],
        "resources": unpacked(recording.resources) or RESOURCES,
        "securityContext": {**_RESTRICTED, "runAsNonRoot": True, **({"runAsUser": user} if user else {})},
        "template": _make_template(recording, spec, claim=claim, user=user),
        "runsOn": list(recording.tiers),
        "qosClass": "best_effort",
        **({"sharedData": {"claimNames": [claim]}} if claim else {}),
    }
    return Component.model_validate({name: value for name, value in fields.items() if value is not None})


def _list_arguments(recording: Recording) -> Iterator[str]:
    yield f"--folder={folder_of('$(ROBOTAPP_APP)', '$(ROBOTAPP_INSTANCE)', recording.name)}"
    yield f"--name={recording.name}"
    for topic in recording.topics.names:
        yield f"--topic={topic}"
    for flag, pattern in (("regex", recording.topics.regex), ("exclude", recording.topics.exclude)):
        if pattern:
            yield f"--{flag}={pattern.replace('$(', '$$(')}"  # the kubelet would look for a variable
    yield f"--split-bytes={parse_bytes(recording.split.size)}"
    if recording.split.duration is not None:
        yield f"--split-seconds={parse_us(recording.split.duration) / 1e6:g}"
    yield f"--retain-bytes={parse_bytes(recording.retain.size)}"


def _make_template(recording: Recording, spec: RobotAppSpec, *, claim: str, user: int) -> dict[str, Any]:
    """Returns the rest of the pod: what all components have alike, so that quotas, policies and meshes admit it as well."""
    most_bytes = parse_bytes(recording.retain.size) + parse_bytes(recording.split.size)
    source: dict[str, Any] = (
        {"persistentVolumeClaim": {"claimName": claim}} if claim else {"emptyDir": {"sizeLimit": str(most_bytes)}}
    )
    pods = [component.template.spec for component in spec.components]
    secrets = [secret for pod in pods for secret in unpacked(pod.image_pull_secrets)]
    pod: dict[str, Any] = {
        "volumes": [{"name": VOLUME, **source}],
        "securityContext": {"fsGroup": user} if user else None,
        "imagePullSecrets": [secret for index, secret in enumerate(secrets) if secret not in secrets[:index]],
        "tolerations": _intersect_lists([unpacked(pod.tolerations) for pod in pods]),
        "priorityClassName": next((pod.priority_class_name for pod in pods if pod.priority_class_name), None),
    }
    metadata = {
        field: _intersect_maps([getattr(component.template.metadata, field) for component in spec.components])
        for field in ("labels", "annotations")
    }
    return {"metadata": metadata, "spec": {name: value for name, value in pod.items() if value not in (None, [])}}


def _intersect_lists(lists: Sequence[Sequence[Any]]) -> list[Any]:
    first, *rest = lists
    return [entry for entry in first if all(entry in other for other in rest)]


def _intersect_maps(maps: Sequence[Mapping[str, str]]) -> dict[str, str]:
    first, *rest = maps
    return {key: value for key, value in first.items() if all(other.get(key) == value for other in rest)}
