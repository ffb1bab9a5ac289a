"""Pods of helpers: discovery servers, router and master. What they take from the app, and what careful clusters ask of every pod.

Priority, tolerations, pull secrets, labels and annotations follow the components, so that quotas, policies and meshes that admit
these admit the helpers. Security and resources are those of Pod Security `restricted` and small.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from robotapp_api.model.app.component import Component
from robotapp_api.model.names import ORDINAL_VARIABLE, Label
from robotapp_api.model.packed import unpacked
from robotapp_api.values.placement.component_nodes import (
    is_in,
    may_be_on_robot,
    require_node,
    required_nodes,
    robot_tolerations,
    tier_terms,
)
from robotapp_api.values.placement.tiers import ROBOT
from robotapp_operator.plan.render.child import instance_labels, selector
from robotapp_operator.plan.render.node_affinity import (
    disconnect_tolerations,
    scheduling_gates,
    shared_node_selector,
    shared_tolerations,
)
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.robot_values import expand_labels, expand_pod

RESOURCES: Final[Mapping[str, Any]] = {
    "requests": {"cpu": "50m", "memory": "64Mi"},
    "limits": {"cpu": "1", "memory": "512Mi"},
}
"""A discovery server or Zenoh router has about 20 MiB, a roscore with its rosout about 130 MiB."""
WRITABLE: Final = ({"name": "HOME", "value": "/tmp"}, {"name": "ROS_HOME", "value": "/tmp/ros"})  # noqa: S108 - within the container
"""A user without an entry in the image's passwd has `/` as home, where ROS tools cannot keep their logs."""
QUICK_END: Final[Mapping[str, Any]] = {"terminationGracePeriodSeconds": 2}
"""For helpers that are scripts (`fastdds discovery`, `ros2 run`): the first process of a container ignores a SIGTERM that it does
not handle, so a RobotApp that is deleted would keep its domain for the 30 s that are the default. They hold nothing to save.
"""
_RESTRICTED: Final[Mapping[str, Any]] = {
    "allowPrivilegeEscalation": False,
    "capabilities": {"drop": ["ALL"]},
    "seccompProfile": {"type": "RuntimeDefault"},
}
_USER_FIELDS: Final = ("runAsUser", "runAsGroup", "runAsNonRoot", "seLinuxOptions")


def render_helper(
    desired: Desired,
    container: Mapping[str, Any],
    labels: Mapping[str, str],
    *,
    home: str,
    node: str = "",
    image_of: Component | None = None,
    pod_fields: Mapping[str, Any] = {},
) -> dict[str, Any]:
    """Returns the pod template of a helper. home: the robot it stays with, "" for none. node: where it must run.

    image_of: the component whose image it runs, and therefore its user. pod_fields: more fields of its pod, such as `hostname`.
    """
    template = desired.app.helper_template
    spec = {
        "schedulerName": desired.app.scheduler_name,
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,
        "serviceAccountName": template.spec.service_account_name or _read_shared(desired, "service_account_name"),
        "priorityClassName": template.spec.priority_class_name or _read_first(desired, "priority_class_name"),
        "runtimeClassName": template.spec.runtime_class_name,
        "imagePullSecrets": _collect_pull_secrets(desired),
        "securityContext": _choose_pod_security(desired, image_of),
        "containers": [_render_container(desired, container, image_of)],
        "affinity": _choose_affinity(desired, labels, home=home, node=node),
        "tolerations": _collect_tolerations(desired, home=home),
        "nodeSelector": shared_node_selector(desired) | unpacked(template.spec.node_selector),
        **pod_fields,
        **scheduling_gates(desired),
    }
    annotations = _share_entries(desired, "annotations") | template.metadata.annotations
    metadata = {
        "labels": {
            **expand_labels(_share_entries(desired, "labels") | template.metadata.labels, desired.instance_values),
            **labels,
        },
        **({"annotations": annotations} if annotations else {}),
    }
    written = {name: plain for name, value in spec.items() if (plain := unpacked(value)) not in (None, [], {}, "")}
    return {"metadata": metadata, "spec": expand_pod(written, desired.instance_values)}


def _render_container(desired: Desired, container: Mapping[str, Any], image_of: Component | None) -> dict[str, Any]:
    helper = desired.app.helper
    policy = helper.image_pull_policy or (image_of.image_pull_policy if image_of else None)
    return {
        **container,
        "env": [*container.get("env", ()), *WRITABLE],
        "resources": unpacked(helper.resources) or RESOURCES,
        "securityContext": unpacked(helper.security_context) or _choose_container_security(desired, image_of),
        **({"imagePullPolicy": policy} if policy else {}),
    }


def _choose_container_security(desired: Desired, image_of: Component | None) -> dict[str, Any]:
    """Returns what `restricted` admits. The image of a component runs as the user that the component has."""
    if image_of is not None:
        context: dict[str, Any] = unpacked(image_of.security_context) or {}
        return {**_RESTRICTED, **{field: context[field] for field in _USER_FIELDS if field in context}}
    pod_context = unpacked(desired.app.helper_template.spec.security_context) or {}
    if "runAsUser" in pod_context or _read_shared(desired, "security_context", "runAsUser") is not None:
        return {**_RESTRICTED, "runAsNonRoot": True}
    users = {(unpacked(component.security_context) or {}).get("runAsUser") for component in desired.app.ros_components}
    user = users.pop() if len(users) == 1 else None
    user = desired.app.helper_defaults.user if user is None else user
    return {**_RESTRICTED, "runAsNonRoot": True, **({"runAsUser": user} if user else {})}


def _choose_pod_security(desired: Desired, image_of: Component | None) -> dict[str, Any] | None:
    pod_context: dict[str, Any] | None = unpacked(desired.app.helper_template.spec.security_context)
    if pod_context is not None:
        return pod_context
    if image_of is not None:
        own_context: dict[str, Any] | None = unpacked(image_of.template.spec.security_context)
        return own_context
    contexts = [unpacked(component.template.spec.security_context) or {} for component in desired.app.ros_components]
    return _intersect(contexts)


def _collect_pull_secrets(desired: Desired) -> list[dict[str, Any]]:
    """Returns the secrets of all components, each once, and those written for helpers."""
    secrets = [
        secret for component in desired.app.ros_components for secret in component.template.spec.image_pull_secrets
    ]
    secrets += [*desired.app.helper_template.spec.image_pull_secrets]
    return [secret for index, secret in enumerate(secrets) if secret not in secrets[:index]]


def _collect_tolerations(desired: Desired, *, home: str) -> list[dict[str, Any]]:
    tolerations = [*shared_tolerations(desired), *desired.app.helper_template.spec.tolerations]
    return tolerations + (robot_tolerations(home) + disconnect_tolerations(None) if home else [])


def _share_entries(desired: Desired, field: str) -> dict[str, str]:
    """Returns labels or annotations that all components have alike: a Service that selects a single component selects no helper.

    Those with the ordinal of a replica differ, although they are written alike.
    """
    entries = _intersect([getattr(component.template.metadata, field) for component in desired.app.ros_components])
    return {key: value for key, value in entries.items() if ORDINAL_VARIABLE not in value}


def _intersect(maps: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    first, *rest = maps
    return {key: value for key, value in first.items() if all(key in other and other[key] == value for other in rest)}


def _read_shared(desired: Desired, field: str, key: str = "") -> Any:
    """Returns the value of a pod field, or of an entry of it, that all components have; None for none."""
    values = [getattr(component.template.spec, field) for component in desired.app.ros_components]
    values = [(value or {}).get(key) for value in values] if key else values
    return values[0] if all(value == values[0] for value in values) else None


def _read_first(desired: Desired, field: str) -> Any:
    values = (getattr(component.template.spec, field) for component in desired.app.ros_components)
    return next((value for value in values if value), None)


def _choose_affinity(desired: Desired, labels: Mapping[str, str], *, home: str, node: str) -> dict[str, Any]:
    """Returns where the pod goes: on `node`; else never on a foreign robot, on the robot `home`, and near the components.

    Siblings of a role are preferably on different nodes. Our scheduler counts the round trips to the components as well;
    for others the zone of most components has to do.
    """
    near = {Label.APP.value, Label.INSTANCE.value}
    members = {
        "matchLabels": {key: value for key, value in instance_labels(desired).items() if key in near},
        "matchExpressions": [{"key": Label.COMPONENT.value, "operator": "Exists"}],
    }
    affinity: dict[str, Any] = {
        "nodeAffinity": _choose_node_affinity(desired, home=home, node=node, alone=Label.PART.value not in labels),
        "podAffinity": _prefer_pods(members, (Label.ZONE, 50), (Label.HOSTNAME, 10)),
    }
    if Label.PART.value in labels:
        siblings = {key: value for key, value in selector(dict(labels)).items() if key != Label.PART.value}
        affinity["podAntiAffinity"] = _prefer_pods({"matchLabels": siblings}, (Label.HOSTNAME, 100))
    return {kind: rules for kind, rules in affinity.items() if rules}


def _choose_node_affinity(desired: Desired, *, home: str, node: str, alone: bool) -> dict[str, Any]:
    if node:
        return require_node(node)
    components = desired.app.ros_components
    if not desired.robot_name:
        if any(component.runs_on for component in components) and not any(
            may_be_on_robot(component.runs_on, "") for component in components
        ):
            return required_nodes([[{"key": Label.ROBOT.value, "operator": "DoesNotExist"}]])
        free = {"key": Label.ROBOT.value, "operator": "DoesNotExist"}
        only_robots = all(component.runs_on == (ROBOT,) for component in components)
        return {} if only_robots else _prefer_nodes(free)
    own_or_none = required_nodes(tier_terms((), desired.robot_name))
    if not home:
        return own_or_none
    if alone and any(component.runs_on == (ROBOT,) for component in components):
        # It goes back on board after a drain, for the robot must find it while it is out of reach.
        return required_nodes([[is_in(Label.ROBOT, home)]])
    return own_or_none | _prefer_nodes(is_in(Label.ROBOT, home))


def _prefer_nodes(requirement: Mapping[str, Any]) -> dict[str, Any]:
    preference = {"weight": 100, "preference": {"matchExpressions": [requirement]}}
    return {"preferredDuringSchedulingIgnoredDuringExecution": [preference]}


def _prefer_pods(label_selector: Mapping[str, Any], *keys: tuple[Label, int]) -> dict[str, Any]:
    terms = [
        {"weight": weight, "podAffinityTerm": {"topologyKey": key.value, "labelSelector": label_selector}}
        for key, weight in keys
    ]
    return {"preferredDuringSchedulingIgnoredDuringExecution": terms}
