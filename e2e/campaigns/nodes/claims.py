"""ResourceClaims and pods that use them, for tests on real nodes."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from campaigns.nodes.real_pods import FOREVER, get, pod
from robotapp_claims.rules.device_attributes import DRIVER, selector_of
from robotapp_claims.rules.node_devices import Device as Kind
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.processes.process import Process
from robotapp_testbed.real import RealNodes

Json = dict[str, Any]
CLAIMS = "/apis/resource.k8s.io/v1/namespaces/{}/resourceclaims"
SLICES = "/apis/resource.k8s.io/v1/resourceslices"
RESTRICTED: Json = {
    "runAsNonRoot": True,
    "runAsUser": 1000,
    "runAsGroup": 1000,
    "seccompProfile": {"type": "RuntimeDefault"},
}
_PUBLISHED_S = 60.0


class Wish(Kind):
    """A wish for a device, as a component writes it."""

    usb_id: str | None = None


def selector_for(kind: str) -> str:
    """CEL that matches all devices of a kind."""
    return selector_of(Wish("", kind))


def claim(name: str, selectors: Mapping[str, str], configs: Sequence[Json] = ()) -> Json:
    """A claim with one request per name, each with a CEL selector. configs: `requests` and the fields of a DeviceConfig."""
    requests = [
        {"name": request, "exactly": {"deviceClassName": DRIVER, "selectors": [{"cel": {"expression": expression}}]}}
        for request, expression in selectors.items()
    ]
    entries = []
    for config in configs:
        fields = {key: value for key, value in config.items() if key != "requests"}
        parameters = {"apiVersion": f"{DRIVER}/v1alpha1", "kind": "DeviceConfig", **fields}
        opaque = {"driver": DRIVER, "parameters": parameters}
        entries.append({"requests": config["requests"], "opaque": opaque})
    return {
        "apiVersion": "resource.k8s.io/v1",
        "kind": "ResourceClaim",
        "metadata": {"name": name},
        "spec": {"devices": {"requests": requests, "config": entries}},
    }


def user_of(claim_name: str, name: str, command: Sequence[str] = FOREVER, **spec: Any) -> Json:
    """A pod as `restricted` wants it whose container has all devices of the claim."""
    container = {
        "resources": {"claims": [{"name": "devices"}]},
        "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
    }
    body = pod(
        name,
        "",
        command,
        securityContext=RESTRICTED,
        resourceClaims=[{"name": "devices", "resourceClaimName": claim_name}],
        container=container,
        **spec,
    )
    del body["spec"]["nodeName"]
    return body


def talk_alone(lines: int) -> str:
    """Shell: writes lines to the serial port of request `arm` and reads each again; fails when it reads another program's."""
    return (
        f'exec 3<>"$ROBOTAPP_DEVICE_ARM"; for turn in $(seq {lines}); do echo "$HOSTNAME $turn" >&3; read line <&3; '
        'test "$line" = "$HOSTNAME $turn" || { echo "$line"; exit 1; }; sleep 0.1; done'
    )


def driver_on(cp: RealNodes, node: str) -> Process:
    """The driver of the node as a program in its box, not started yet: one that can be killed and started as often as wanted."""
    options = [f"--kubeconfig={cp.kubeconfig()}", f"--node-name={node}"]
    return cp.node(node).box.program("driver", [sys.executable, "-m", "robotapp_agent.driver", *options])


def published(cp: ControlPlane, node: str) -> dict[str, Json]:
    """Devices in the node's ResourceSlices, by name."""
    slices = [
        resource_slice["spec"]
        for resource_slice in cp.api.get(SLICES)["items"]
        if resource_slice["spec"].get("nodeName") == node
    ]
    return {device["name"]: device for spec in slices for device in spec.get("devices") or ()}


def wait_published(cp: ControlPlane, node: str, *ids: str) -> bool:
    """Returns whether the node publishes these devices, and no other, within a minute."""
    return wait_until(lambda: set(published(cp, node)) == set(ids), timeout_s=_PUBLISHED_S, poll_s=0.2)


def events_of(cp: ControlPlane, namespace: str, name: str) -> str:
    """Messages of all events about a pod."""
    items = cp.api.get(f"/api/v1/namespaces/{namespace}/events?fieldSelector=involvedObject.name={name}")["items"]
    return "\n".join(item.get("message") or "" for item in items)


def place_past_schedulers(
    cp: ControlPlane, namespace: str, user: Json, *, request: str, device: str, node: str
) -> None:
    """Creates the pod, allocates its one claim and binds it, as a second scheduler would that has not seen the first one's claims."""
    user = {**user, "spec": {**user["spec"], "schedulerName": "nobody"}}
    cp.kubectl("apply", "-n", namespace, "-f", "-", stdin=[user])
    name, claim_name = user["metadata"]["name"], user["spec"]["resourceClaims"][0]["resourceClaimName"]
    consumer = {"resource": "pods", "name": name, "uid": get(cp, namespace, name)["metadata"]["uid"]}
    result = {"request": request, "driver": DRIVER, "pool": node, "device": device}
    term = {"matchFields": [{"key": "metadata.name", "operator": "In", "values": [node]}]}
    allocation = {"devices": {"results": [result]}, "nodeSelector": {"nodeSelectorTerms": [term]}}
    status = {"allocation": allocation, "reservedFor": [consumer]}
    path = f"{CLAIMS.format(namespace)}/{claim_name}"
    # With it the claim controller takes the allocation back when the pod has ended.
    cp.api.patch(path, {"metadata": {"finalizers": ["resource.kubernetes.io/delete-protection"]}})
    cp.api.patch(f"{path}/status", {"status": status})
    target = {"apiVersion": "v1", "kind": "Node", "name": node}
    binding = {"apiVersion": "v1", "kind": "Binding", "metadata": {"name": name}, "target": target}
    cp.api.create(f"/api/v1/namespaces/{namespace}/pods/{name}/binding", binding)
