"""The pod template of one component. Its hash is pinned by a golden test: a new operator version must not roll robots."""

import dataclasses
from typing import Any, Final

from robotapp_api.model.component import Component
from robotapp_api.model.names import SCHEDULING_GATE, Annotation
from robotapp_operator.plan.children import component_labels
from robotapp_operator.plan.environment import ros2_environment
from robotapp_operator.plan.probes import readiness_probe
from robotapp_operator.plan.ros1 import ros1_environment
from robotapp_operator.plan.where import affinity, tolerations
from robotapp_operator.plan.wish import Domain, Wish

PARAMS_VOLUME: Final = "robotapp-params"
PARAMS_PATH: Final = "/etc/robotapp/params"
PARAMS_FILE: Final = "params.yaml"
GRANTED_DEVICES_PATH: Final = f"metadata.annotations['{Annotation.GRANTED_DEVICES.value}']"
PEER_WAIT_S: Final = 10
"""A peer that is late is found later through its own announcement; waiting longer would only delay the others."""


@dataclasses.dataclass(frozen=True, slots=True)
class ParamsFile:
    """The key of the ConfigMap that is this instance's file, and the hash of its content ("" while it is missing)."""

    key: str = PARAMS_FILE
    hash: str = ""


def pod_template(component: Component, wish: Wish, *, domain: Domain | None, params: ParamsFile) -> dict[str, Any]:
    """Labels, annotations and spec of the component's pods."""
    annotations = {Annotation.PARAMS_HASH.value: params.hash} if component.params else {}
    if domain is not None and domain.claim:
        annotations[Annotation.DOMAIN_CLAIM.value] = domain.claim  # spares the scheduler a search
    spec = {
        "schedulerName": wish.app.spec.scheduler_name,
        # A robot's process has no business with the API server unless its author gave it an account.
        "automountServiceAccountToken": component.service_account_name is not None,
        "enableServiceLinks": False,
        "serviceAccountName": component.service_account_name,
        "priorityClassName": component.priority_class_name,
        "runtimeClassName": component.runtime_class_name,
        "terminationGracePeriodSeconds": component.termination_grace_period_seconds,
        "securityContext": component.pod_security_context,
        "imagePullSecrets": list(component.image_pull_secrets),
        "nodeSelector": component.node_selector,
        "affinity": affinity(component, wish),
        "tolerations": tolerations(component, wish),
        "initContainers": [*_waiting(component, wish), *component.init_containers],
        "containers": [container(component, wish, domain=domain)],
        "volumes": [*component.volumes, *_params_volume(component, params)],
        **_peer_identity(component, wish),
    }
    if not wish.app.our_scheduler and domain is not None:
        spec["schedulingGates"] = [{"name": SCHEDULING_GATE}]
    return {
        "metadata": {"labels": component_labels(wish, component.name), **_written(annotations=annotations)},
        "spec": _written(**spec),
    }


def container(component: Component, wish: Wish, *, domain: Domain | None) -> dict[str, Any]:
    """The component's container."""
    mounts = [{"name": PARAMS_VOLUME, "mountPath": PARAMS_PATH, "readOnly": True}] if component.params else []
    ros_args = ["--ros-args", "--params-file", f"{PARAMS_PATH}/{PARAMS_FILE}"] if component.params else []
    return _written(
        name=component.name,
        image=component.image,
        command=list(component.command),
        args=[*component.args, *ros_args],
        env=environment(component, wish, domain=domain),
        envFrom=list(component.env_from),
        ports=list(component.ports),
        volumeMounts=[*component.volume_mounts, *mounts],
        resources=component.resources,
        imagePullPolicy=component.image_pull_policy,
        securityContext=component.security_context,
        readinessProbe=readiness_probe(component, ros_version=wish.app.ros_version),
        lifecycle={"preStop": component.pre_stop} if component.pre_stop else None,
    )


def environment(component: Component, wish: Wish, *, domain: Domain | None) -> list[dict[str, Any]]:
    """Ours first, so that the component's own variables can refer to them; its own value wins where both set one."""
    ours = [
        {"name": "ROBOTAPP_NAME", "value": wish.app.name},
        {"name": "ROBOTAPP_COMPONENT", "value": component.name},
        {"name": "ROBOTAPP_ROBOT", "value": wish.robot},
        *_ros_environment(wish, domain=domain),
    ]
    if component.params:
        ours.append({"name": "ROBOTAPP_PARAMS_FILE", "value": f"{PARAMS_PATH}/{PARAMS_FILE}"})
    if component.devices:
        ours.append({"name": "ROBOTAPP_DEVICES", "valueFrom": {"fieldRef": {"fieldPath": GRANTED_DEVICES_PATH}}})
    own = {variable["name"] for variable in component.env}
    return [*(variable for variable in ours if variable["name"] not in own), *component.env]


def _ros_environment(wish: Wish, *, domain: Domain | None) -> list[dict[str, Any]]:
    if wish.app.ros_version == 1 or domain is None:
        return ros1_environment(wish)
    return [{"name": variable.name, "value": variable.value} for variable in ros2_environment(wish, domain=domain.id)]


def _params_volume(component: Component, params: ParamsFile) -> list[dict[str, Any]]:
    if component.params is None:
        return []
    items = [{"key": params.key, "path": PARAMS_FILE}]
    return [{"name": PARAMS_VOLUME, "configMap": {"name": component.params.config_map, "items": items}}]


def _peer_identity(component: Component, wish: Wish) -> dict[str, str]:
    """A DNS name per component, under the headless Service."""
    if wish.discovery != "Peers":
        return {}
    return {"hostname": component.name, "subdomain": wish.peers_service}


def _waiting(component: Component, wish: Wish) -> list[dict[str, Any]]:
    """An init step that gives the names discovery needs up to 10 s to resolve; it runs in the component's own image.

    Cyclone resolves its peers once, when it starts; Fast DDS its servers likewise.
    """
    names = wish.names_to_await(component.name)
    if not names:
        return []
    script = (
        f"i=0; for name in {' '.join(names)}; do "
        f"until getent hosts $name >/dev/null || [ $i -ge {PEER_WAIT_S} ]; do sleep 1; i=$((i+1)); done; done"
    )
    step = _written(
        name="wait-for-names",
        image=component.image,
        imagePullPolicy=component.image_pull_policy,
        securityContext=component.security_context,
        command=["sh", "-c", script],
    )
    return [step]


def _written(**fields: Any) -> dict[str, Any]:
    """Only what says something: the API server would drop the rest, and we would see a difference for ever."""
    return {name: value for name, value in fields.items() if value is not None and value not in ([], {}, "")}
