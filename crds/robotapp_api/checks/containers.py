"""Lists the containers of a component's pod, and finds fields of theirs that would be lost in silence.

Such a field needs another field of the pod, or a newer Kubernetes.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from robotapp_api.checks.host_access.paths import walk_path
from robotapp_api.checks.middleware import FAST_DDS
from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.checks.ros import rmw_of, ros_version_of
from robotapp_api.model.app.component import Component
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.names import PARAMETERS_VOLUME, SHARED_MEMORY_PATH, SHARED_MEMORY_VOLUME, WAITING_STEP
from robotapp_api.values.component_references import list_further_containers
from robotapp_api.values.quantities.quantity import parse_milli

STOP_SIGNAL: Final = ".lifecycle.stopSignal"
_NO_STOP_SIGNAL: Final = (
    "needs the feature gate ContainerStopSignals, which is off unless a cluster switches it on and says so to the operator (--stop-signals); "
    "write preStop: {{exec: {{command: [sh, -c, '{interrupt}; sleep 10']}}}}, with which the program has 10 s to end on SIGINT"
)
_UNMASKED: Final = (
    "Unmasked needs a pod with a user namespace of its own, which a RobotApp's pods do not have; leave it out"
)
_PROBES: Final = ("livenessProbe", "readinessProbe", "startupProbe", "lifecycle.postStart", "lifecycle.preStop")
_USER_GATE: Final = "AtomicWriteVolumeUserFields"
_FILES: Final = ("configMap", "secret", "downwardAPI")
_SINCE: Final = {
    "restartPolicyRules": "1.35",
    "env[].valueFrom.fileKeyRef": "1.35",
    "volumeMounts[].bindMountOptions": "VolumeBindMountOptions",
    **{f"{probe}.grpc.mode": "GRPCContainerProbeTLS" for probe in _PROBES[:3]},
    **{f"{probe}.httpGet.protocol": "H2CContainerProbe" for probe in _PROBES},
}
"""Fields of containers that an API server drops without a word, with the first release that has them on, or the gate that is off in all."""
_POD_SINCE: Final = {
    "volumes[].projected.sources[].clusterTrustBundle": "1.37",
    "volumes[].projected.sources[].podCertificate": "1.37",
    "securityContext.supplementalGroupsPolicy": "1.33",
    "securityContext.seLinuxChangePolicy": "1.33",
    "volumes[].emptyDir.mode": "EmptyDirVolumeMode",
    **{f"volumes[].{kind}.defaultUser": _USER_GATE for kind in (*_FILES, "projected")},
    **{f"volumes[].{kind}.items[].user": _USER_GATE for kind in _FILES},
    **{f"volumes[].projected.sources[].{kind}.items[].user": _USER_GATE for kind in _FILES},
    **{
        f"volumes[].projected.sources[].{kind}.user": _USER_GATE
        for kind in ("clusterTrustBundle", "podCertificate", "serviceAccountToken")
    },
}
"""The same of fields of the pod."""

_OUR_VOLUMES: Final = {PARAMETERS_VOLUME: "the parameter files", SHARED_MEMORY_VOLUME: "sharedMemory"}
_TRANSPORTS: Final = "FASTDDS_BUILTIN_TRANSPORTS"


def gated_field_problems(component: Component, at: str) -> Iterator[Problem]:
    """`at`: where the component stands, such as `spec.components[0]`."""
    for container, path in list_containers(component, at):
        if "stopSignal" in (container.get("lifecycle") or {}):
            yield invalid(f"{path}{STOP_SIGNAL}", _NO_STOP_SIGNAL.format(interrupt=_interruption(component)))
        if (container.get("securityContext") or {}).get("procMount") == "Unmasked":
            yield invalid(f"{path}.securityContext.procMount", _UNMASKED)


def _interruption(component: Component) -> str:
    """Returns the command that asks the container's program to end. Process 1 may be the whole pod's, or the node's."""
    pod = component.template.spec
    return "pkill -INT -f PROGRAM" if pod.host_pid or pod.share_process_namespace else "kill -INT 1"


def gated_field_notes(component: Component, at: str) -> Iterator[Note]:
    """Says which fields some clusters drop without acting on them."""
    for container, container_path in list_containers(component, at):
        for path, since in _SINCE.items():
            for place, value in walk_path(container, path.split("."), container_path):
                if value:
                    yield _note_age(place, since)
    for index, container in enumerate(component.template.spec.containers):
        if container.get("restartPolicy"):
            yield _note_age(f"{at}.template.spec.containers[{index}].restartPolicy", "1.35")
    pod = component.template.spec
    fields = {"volumes": pod.volumes, "securityContext": pod.security_context}
    for path, since in _POD_SINCE.items():
        for place, _ in walk_path(fields, path.split("."), f"{at}.template.spec"):
            yield _note_age(place, since)


def _note_age(field: str, since: str) -> Note:
    if since[0].isdigit():
        return Note(field, f"needs Kubernetes {since}; an older API server drops it without a word")
    return Note(
        field, f"needs the feature gate {since}, which is off unless a cluster switches it on: the API server drops it"
    )


def different_user_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Says which sidecars do not hear their component over Fast DDS.

    Processes of one pod count as on one host, so Fast DDS 2 sends between them through shared memory alone, whose files
    another user may not open: topics are listed, and no message comes.
    """
    if ros_version_of(spec) == 1 or rmw_of(spec) not in FAST_DDS or (spec.ros2 and spec.ros2.transport == "UDP"):
        return
    for index, component in enumerate(spec.components):
        pod_context: Mapping[str, Any] = component.template.spec.security_context or {}
        (own_container, _), *steps = list_containers(component, f"spec.components[{index}]")
        for container, path in steps:
            users = [
                (either.get("securityContext") or {}).get("runAsUser", pod_context.get("runAsUser"))
                for either in (own_container, container)
            ]
            chosen = {
                str(variable.get("name"))
                for either in (own_container, container)
                for variable in either.get("env") or ()
            }
            is_beside = container.get("restartPolicy") == "Always" or ".template.spec.containers[" in path
            if is_beside and len(set(users)) == 2 and _TRANSPORTS not in chosen:
                own_user, other_user = ("the user of its image" if user is None else f"user {user}" for user in users)
                yield Note(
                    f"{path}.securityContext.runAsUser",
                    f"{component.name} runs as {own_user} and {container.get('name')} as {other_user}: Fast DDS uses shared memory within "
                    "a pod, so they see each other's topics and get no messages; write the same user, or ros2.transport: UDP",
                )


def list_containers(component: Component, at: str) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yields the component's own container and all others of its pod, with core's names, and where each stands."""
    own_container = {
        "name": component.name,
        "command": component.command,
        "args": component.args,
        "envFrom": component.env_from,
        "ports": component.ports,
        "lifecycle": component.lifecycle,
        "livenessProbe": component.liveness_probe,
        "readinessProbe": component.readiness_probe,
        "startupProbe": component.startup_probe,
        "securityContext": component.security_context,
        "volumeMounts": component.volume_mounts,
        "env": component.env,
    }
    yield own_container, at
    yield from list_further_containers(component, at)


def pod_problems(component: Component, at: str) -> Iterator[Problem]:
    """Finds names and paths that are taken in the pod, and names that nothing has."""
    yield from _name_problems(component, at)
    yield from _volume_problems(component, at)
    if component.shared_memory and parse_milli(component.shared_memory.size) <= 0:
        yield invalid(
            f"{at}.sharedMemory.size",
            f"{component.shared_memory.size} is no size; write for example 512Mi, or remove it",
        )


def shared_memory_notes(component: Component, at: str) -> Iterator[Note]:
    """Says when the container may not use all of the shared memory, which counts as memory of whoever writes to it."""
    limit = (component.resources.get("limits") or {}).get("memory")
    if component.shared_memory and limit and parse_milli(limit) <= parse_milli(component.shared_memory.size):
        yield Note(
            f"{at}.sharedMemory.size",
            f"what {component.name} writes there counts towards its memory limit {limit}, so it ends before {component.shared_memory.size} "
            "are full; raise resources.limits.memory",
        )


def _name_problems(component: Component, at: str) -> Iterator[Problem]:
    """Names are unique within a pod, and the component's own container and the operator's waiting step have theirs."""
    owners = {component.name: "the component itself", WAITING_STEP: "the operator's own step"}
    for container, path in list_further_containers(component, at):
        name = str(container.get("name", ""))
        if name in owners:
            yield invalid(f"{path}.name", f"{name} is the name of {owners[name]}; write another name")
        owners.setdefault(name, "another container of the pod")


def _volume_problems(component: Component, at: str) -> Iterator[Problem]:
    volumes = [str(volume.get("name", "")) for volume in component.template.spec.volumes]
    for index, name in enumerate(volumes):
        if name in _OUR_VOLUMES:
            yield invalid(
                f"{at}.template.spec.volumes[{index}].name",
                f"{name} is the volume of {_OUR_VOLUMES[name]}; write another name",
            )
    mountable = {*volumes, PARAMETERS_VOLUME}
    for container, path in list_containers(component, at):
        for index, mount in enumerate(container.get("volumeMounts") or ()):
            mount_at = f"{path}.volumeMounts[{index}]"
            if (name := str(mount.get("name", ""))) not in mountable:
                yield invalid(f"{mount_at}.name", f'there is no volume "{name}"; write it under template.spec.volumes')
            if component.shared_memory and str(mount.get("mountPath", "")).rstrip("/") == SHARED_MEMORY_PATH:
                yield invalid(
                    f"{mount_at}.mountPath",
                    f"{SHARED_MEMORY_PATH} is where sharedMemory is; remove this mount, or sharedMemory",
                )
