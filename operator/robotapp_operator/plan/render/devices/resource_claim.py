"""The ResourceClaim of a component whose devices a driver hands over, and what its pod template says about it."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, Final

from robotapp_api.model.app.component import Component
from robotapp_api.model.app.device import Device
from robotapp_api.model.names import POD_CLAIM, QUEUE_NAME, WAITING_STEP, Annotation
from robotapp_api.values.devices.variables import DEVICE_PREFIX, device_variable
from robotapp_api.values.devices.words import list_types
from robotapp_claims.rules.device import claimed
from robotapp_claims.rules.device_attributes import DRIVER, selector_of
from robotapp_operator.plan.render.child import Child, owner_reference
from robotapp_operator.plan.spec.covers import content_hash
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import pod_spec

CONFIG_VERSION: Final = f"{DRIVER}/v1alpha1"
_NETWORK: Final = "can"
"""A network interface, which the driver moves into no pod: only one in its node's network can use it."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class DeviceClaim:
    """A wanted ResourceClaim. `hash` covers its spec, which the API server lets nobody change."""

    name: str
    labels: dict[str, str]
    spec: dict[str, Any]
    hash: str

    def body(self, app: App) -> dict[str, Any]:
        """The object to create. Its owner does not wait for it, and it has no finalizer: deletion needs none of our programs."""
        return {
            "apiVersion": "resource.k8s.io/v1",
            "kind": "ResourceClaim",
            "metadata": {
                "name": self.name,
                "namespace": app.namespace,
                "labels": self.labels,
                "annotations": {Annotation.CONTENT_HASH.value: self.hash},
                "ownerReferences": [owner_reference(app) | {"blockOwnerDeletion": False}],
            },
            "spec": self.spec,
        }


def may_be_handed_over(component: Component) -> bool:
    """Whether a driver could give the component all devices that it wants for itself, and there are any.

    A CAN bus is of use in the node's network alone, so the bus of another pod is reserved as where there is no driver.
    """
    exclusive = [device for device in component.devices if claimed(device)]
    has_network = bool(component.template.spec.host_network)
    return bool(exclusive) and (has_network or not any(_is_network(device) for device in exclusive))


def claim_spec(component: Component) -> dict[str, Any]:
    """Returns the spec of the component's ResourceClaim: a request for each exclusive device, with what the driver does about it."""
    exclusive = [device for device in component.devices if claimed(device)]
    return {
        "devices": {
            "requests": [
                {
                    "name": device.name,
                    "exactly": {
                        "deviceClassName": DRIVER,
                        "allocationMode": "ExactCount",
                        "count": device.count,
                        "selectors": [{"cel": {"expression": selector_of(device)}}],
                    },
                }
                for device in exclusive
            ],
            "config": [
                {"requests": [device.name], "opaque": {"driver": DRIVER, "parameters": _config_of(device)}}
                for device in exclusive
            ],
        }
    }


def _config_of(device: Device) -> dict[str, Any]:
    config = {
        "apiVersion": CONFIG_VERSION,
        "kind": "DeviceConfig",
        "env": device_variable(device.name).removeprefix(DEVICE_PREFIX),
    }
    if device.mount_as:
        config["mountAs"] = device.mount_as
    return config | ({"network": "Host"} if _is_network(device) else {})


def _is_network(device: Device) -> bool:
    return _NETWORK in list_types(device.type)


def name_claim(template: dict[str, Any], component: Component, *, claim: str) -> dict[str, Any]:
    """Returns the pod template with the claim, which each of its containers uses; another wish starts the pod anew."""
    spec, metadata = template["spec"], template["metadata"]
    annotations = {
        **metadata.get("annotations", {}),
        Annotation.DEVICES_HASH.value: content_hash(claim_spec(component)),
    }
    containers = {
        kind: [item if item["name"] == WAITING_STEP else _use_claim(item) for item in spec[kind]]
        for kind in ("initContainers", "containers")
        if kind in spec
    }
    claims = [{"name": POD_CLAIM, "resourceClaimName": claim}]
    return {
        "metadata": {**metadata, "annotations": annotations},
        "spec": {**spec, **containers, "resourceClaims": claims},
    }


def _use_claim(container: Mapping[str, Any]) -> dict[str, Any]:
    return {**container, "resources": {**(container.get("resources") or {}), "claims": [{"name": POD_CLAIM}]}}


def named_claim(deployment_spec: Mapping[str, Any]) -> str:
    """Returns the ResourceClaim that a Deployment's pods name for their devices, "" for none."""
    entries = pod_spec(deployment_spec).get("resourceClaims") or ()
    names = (entry.get("resourceClaimName") or "" for entry in entries if entry.get("name") == POD_CLAIM)
    return next(names, "")


def wanted_claims(app: App, children: Iterable[Child]) -> list[DeviceClaim]:
    """Returns the ResourceClaims of Deployments and Jobs that are to have pods. One without pods gives its devices back."""
    components = {component.name: component for component in app.spec.components}
    claims = []
    for child in children:
        name = named_claim(child.spec)
        component = components.get(child.component)
        # A Job in a queue is made suspended, and kueue resumes it.
        is_queued = QUEUE_NAME in child.labels and "suspend" in child.spec
        wants_pods = child.spec.get("replicas") or child.spec.get("suspend") is False or is_queued
        if name and component is not None and wants_pods:
            spec = claim_spec(component)
            claims.append(DeviceClaim(name=name, labels=child.labels, spec=spec, hash=content_hash(spec)))
    return claims
