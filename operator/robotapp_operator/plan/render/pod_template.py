"""The pod template of one component. Its hash is pinned by a golden test: a new operator version must not roll robots."""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.checks.containers import list_containers
from robotapp_api.checks.host_access.network import shares_memory
from robotapp_api.model.app.component import Component
from robotapp_api.model.names import (
    INSTANCE_VARIABLE,
    ORDINAL_VARIABLE,
    REPLICAS_VARIABLE,
    ROBOT_VARIABLE,
    SHARED_MEMORY_PATH,
    SHARED_MEMORY_VOLUME,
    WAITING_STEP,
    Annotation,
)
from robotapp_api.model.packed import unpacked
from robotapp_operator.plan.render.child import component_labels
from robotapp_operator.plan.render.command_line import full_node_name, parameter_variables, render_arguments
from robotapp_operator.plan.render.devices.variables import device_variables
from robotapp_operator.plan.render.environment import join_environment, ros1_environment, ros2_environment
from robotapp_operator.plan.render.node_affinity import affinity, scheduling_gates, tolerations
from robotapp_operator.plan.render.parameters import (
    ParameterState,
    parameter_annotations,
    parameter_mount,
    parameter_volume,
)
from robotapp_operator.plan.render.readiness_probes import readiness_probe
from robotapp_operator.plan.spec.desired import Desired, Domain
from robotapp_operator.plan.spec.robot_values import expand_labels, expand_pod

DEFAULT_ACCOUNT: Final = "default"
GRANTED_DEVICES_PATH: Final = f"metadata.annotations['{Annotation.GRANTED_DEVICES.value}']"
PEER_WAIT_S: Final = 10
"""A peer that is late is found later through its own announcement; waiting longer would only delay the others."""


def pod_template(
    component: Component,
    desired: Desired,
    *,
    domain: Domain | None,
    state: ParameterState,
    master_starts: str = "",
    attempt: str = "",
    by_claim: bool = False,
) -> dict[str, Any]:
    """Returns labels, annotations and spec of the component's pods.

    master_starts: those for which they were restarted. attempt: number of the instance's attempt, "" for the first one.
    by_claim: their devices come by a ResourceClaim.
    """
    template = component.template.spec
    annotations = component.template.metadata.annotations | parameter_annotations(component, desired, state)
    if domain is not None and domain.claim and desired.app.uses_ros(component):
        annotations[Annotation.DOMAIN_CLAIM.value] = domain.claim  # spares the scheduler a search
    restarts = {Annotation.MASTER_STARTS.value: master_starts, Annotation.ATTEMPT.value: attempt}
    annotations |= {key: text for key, text in restarts.items() if text}
    spec = {
        "schedulerName": desired.app.scheduler_name,
        # A robot's process has no business with the API server unless its author gave it an account. `default` is what
        # every pod runs as and every writer of RobotApps may name: its token is lent to none of them.
        "automountServiceAccountToken": template.service_account_name not in (None, DEFAULT_ACCOUNT),
        "enableServiceLinks": False,
        "serviceAccountName": template.service_account_name,
        "priorityClassName": template.priority_class_name,
        "runtimeClassName": template.runtime_class_name,
        "terminationGracePeriodSeconds": template.termination_grace_period_seconds,
        "securityContext": template.security_context,
        "imagePullSecrets": list(template.image_pull_secrets),
        "nodeSelector": template.node_selector,
        "affinity": affinity(component, desired, by_claim=by_claim),
        "tolerations": tolerations(component, desired),
        "initContainers": [
            *(_waiting(component, desired) if desired.app.uses_ros(component) else ()),
            *(_further_container(step, component, desired, domain=domain) for step in template.init_containers),
        ],
        "containers": [
            container(component, desired, domain=domain, state=state),
            *(_further_container(sidecar, component, desired, domain=domain) for sidecar in template.containers),
        ],
        "volumes": [*template.volumes, *parameter_volume(component, desired, state), *_shared_memory(component)],
        "hostAliases": list(template.host_aliases),
        "dnsConfig": template.dns_config,
        "hostname": template.hostname,
        **_peer_identity(component, desired),
        **_host_namespaces(component),
        **_operating_system(component),
        **scheduling_gates(desired),
    }
    values = desired.values_of(component.name)
    labels = expand_labels(component.template.metadata.labels, values) | component_labels(desired, component.name)
    return {
        "metadata": {"labels": labels, **_written(annotations=annotations)},
        "spec": expand_pod(_written(**spec), values),
    }


def container(
    component: Component, desired: Desired, *, domain: Domain | None, state: ParameterState
) -> dict[str, Any]:
    """The component's container."""
    return _written(
        name=component.name,
        image=component.image,
        command=list(component.command),
        args=render_arguments(component, desired, state),
        workingDir=component.working_dir,
        env=environment(component, desired, domain=domain, state=state),
        envFrom=list(component.env_from),
        ports=list(component.ports),
        volumeMounts=[
            *component.volume_mounts,
            *parameter_mount(component, state),
            *_shared_memory_mount(component),
        ],
        stdin=component.stdin or None,
        tty=component.tty or None,
        resources=component.resources,
        imagePullPolicy=component.image_pull_policy,
        securityContext=component.security_context,
        readinessProbe=readiness_probe(component, desired.app, node=full_node_name(component, desired)),
        livenessProbe=component.liveness_probe,
        startupProbe=component.startup_probe,
        lifecycle=component.lifecycle,
    )


def environment(
    component: Component, desired: Desired, *, domain: Domain | None, state: ParameterState
) -> list[dict[str, Any]]:
    """Returns the container's variables, ours first so that the component's own can refer to them.

    docs/environment.md is the contract: a variable here is a line there.
    """
    ours = _pod_environment(component, desired, domain=domain)
    ours += parameter_variables(component, desired, state)
    if component.devices:
        ours.append({"name": "ROBOTAPP_DEVICES", "valueFrom": {"fieldRef": {"fieldPath": GRANTED_DEVICES_PATH}}})
    return join_environment(ours, component.env)


def _further_container(
    written: Mapping[str, Any], component: Component, desired: Desired, *, domain: Domain | None
) -> dict[str, Any]:
    """Returns an init container or sidecar of the component as it runs: with the variables of ROS and the pod's shared memory."""
    result = add_environment(written, component, desired, domain=domain)
    mount = _shared_memory_mount(component)
    return {**result, "volumeMounts": [*(written.get("volumeMounts") or ()), *mount]} if mount else result


def add_environment(
    step: Mapping[str, Any], component: Component, desired: Desired, *, domain: Domain | None
) -> dict[str, Any]:
    """Returns an init container or sidecar of the component with the variables of ROS: without them it is in domain 0."""
    return {**step, "env": join_environment(_pod_environment(component, desired, domain=domain), step.get("env") or ())}


def _pod_environment(component: Component, desired: Desired, *, domain: Domain | None) -> list[dict[str, Any]]:
    """Returns the variables of every container of the component's pod."""
    return [
        {"name": "ROBOTAPP_APP", "value": desired.app.name},
        {"name": INSTANCE_VARIABLE, "value": desired.robot},
        {"name": ROBOT_VARIABLE, "value": desired.robot_name},
        {"name": "ROBOTAPP_COMPONENT", "value": desired.app.written_name(component.name)},
        *({"name": name, "value": value} for name, value in desired.matrix_variables.items()),
        *device_variables(component),
        *_replica_environment(component, desired),
        *(_ros_environment(component, desired, domain=domain) if desired.app.uses_ros(component) else ()),
    ]


def _replica_environment(component: Component, desired: Desired) -> list[dict[str, Any]]:
    """Returns which of its component's replicas the pod is, and the Service under which all of them have their names."""
    replica = desired.app.replicas.get(component.name)
    if replica is None:
        return []
    return [
        {"name": ORDINAL_VARIABLE, "value": str(replica.ordinal)},
        {"name": REPLICAS_VARIABLE, "value": desired.replicas_service(component.name)},
    ]


def _ros_environment(component: Component, desired: Desired, *, domain: Domain | None) -> list[dict[str, Any]]:
    distro = {"name": "ROS_DISTRO", "value": desired.distro}
    if desired.app.ros_version == 1 or domain is None:
        return [distro, *ros1_environment(desired)]
    variables = ros2_environment(desired, domain=domain.id, shares_memory=shares_memory(component))
    return [distro, *({"name": variable.name, "value": variable.value} for variable in variables)]


def _host_namespaces(component: Component) -> dict[str, Any]:
    """Returns which namespaces of its node the pod has in place of its own, and whether its containers share processes.

    A pod in its node's network would ask the node's DNS servers, which know no Service.
    """
    pod = component.template.spec
    written = {
        "hostNetwork": pod.host_network,
        "hostIPC": pod.host_ipc,
        "hostPID": pod.host_pid,
        "shareProcessNamespace": pod.share_process_namespace,
    }
    fields: dict[str, Any] = {name: True for name, is_on in written.items() if is_on}
    return fields | ({"dnsPolicy": "ClusterFirstWithHostNet"} if pod.host_network else {})


def _operating_system(component: Component) -> dict[str, Any]:
    """Returns the operating system of the pod, without which the API server takes no stop signal."""
    if any("stopSignal" in (each.get("lifecycle") or {}) for each, _ in list_containers(component, "")):
        return {"os": {"name": "linux"}}
    return {}


def _shared_memory(component: Component) -> list[dict[str, Any]]:
    """Returns the volume behind /dev/shm of the size that the component wants; without it the runtime gives 64 MiB."""
    if component.shared_memory is None:
        return []
    return [
        {
            "name": SHARED_MEMORY_VOLUME,
            "emptyDir": {"medium": "Memory", "sizeLimit": str(component.shared_memory.size)},
        }
    ]


def _shared_memory_mount(component: Component) -> list[dict[str, Any]]:
    if component.shared_memory is None:
        return []
    return [{"name": SHARED_MEMORY_VOLUME, "mountPath": SHARED_MEMORY_PATH}]


def _peer_identity(component: Component, desired: Desired) -> dict[str, str]:
    """Returns host name and Service that give the pod a DNS name: with peers each component, else replicas that have ordinals."""
    if component.name in desired.app.replicas:
        return {"hostname": component.name, "subdomain": desired.replicas_service(component.name)}
    if desired.discovery != "Peers" or not desired.app.uses_ros(component):
        return {}
    return {"hostname": component.name, "subdomain": desired.peers_service}


def _waiting(component: Component, desired: Desired) -> list[dict[str, Any]]:
    """An init step that gives the names discovery needs up to 10 s to resolve; it runs in the component's own image.

    Cyclone resolves its peers once, when it starts; Fast DDS its servers likewise.
    """
    names = desired.names_to_await(component.name)
    if not names:
        return []
    script = (
        f"i=0; for name in {' '.join(names)}; do "
        f"until getent hosts $name >/dev/null || [ $i -ge {PEER_WAIT_S} ]; do sleep 1; i=$((i+1)); done; done"
    )
    step = _written(
        name=WAITING_STEP,
        image=component.image,
        imagePullPolicy=component.image_pull_policy,
        securityContext=component.security_context,
        resources=copy_resources(component),
        command=["sh", "-c", script],
    )
    return [step]


def copy_resources(component: Component) -> dict[str, Any]:
    """Returns CPU, memory and storage of the component for a step of ours: a quota refuses a container without them.

    A pod's steps run before its containers, so its request does not grow. Devices are left to the container.
    """
    plain = ("cpu", "memory", "ephemeral-storage")
    kinds = {kind: component.resources.get(kind) or {} for kind in ("requests", "limits")}
    resources = {kind: {name: amount for name, amount in of.items() if name in plain} for kind, of in kinds.items()}
    return {kind: amounts for kind, amounts in resources.items() if amounts}


def _written(**fields: Any) -> dict[str, Any]:
    """Only fields with a value: the API server would drop the rest, and we would see a difference for ever."""
    plain = {name: unpacked(value) for name, value in fields.items()}
    return {name: value for name, value in plain.items() if value is not None and value not in ([], {}, "")}
