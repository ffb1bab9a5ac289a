"""Services of an instance: the headless one over its components, and stable addresses of its infrastructure."""

from typing import Any

from robotapp_operator.plan.render.child import SERVICE, Child, instance_labels, selector
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.objects import ChildRef


def peers_service(desired: Desired) -> Child:
    """Headless: a name per pod, published before it is ready, because discovery happens while starting."""
    labels = instance_labels(desired)
    return _service(
        desired.peers_service, labels, selector(labels), {"clusterIP": "None", "publishNotReadyAddresses": True}
    )


def role_service(
    desired: Desired, *, name: str, role: str, labels: dict[str, str], port: int, protocol: str, headless: bool
) -> Child:
    """`headless` for UDP: an answer would come from the pod's own address, not the Service's."""
    kind: dict[str, Any] = {"clusterIP": "None"} if headless else {}
    spec = {
        **kind,
        "publishNotReadyAddresses": headless,
        "ports": [{"name": role, "port": port, "protocol": protocol, "targetPort": port}],
    }
    return _service(name, instance_labels(desired), selector(labels), spec)


def _service(name: str, labels: dict[str, str], pods: dict[str, str], spec: dict[str, Any]) -> Child:
    return Child(ref=ChildRef(SERVICE, name), labels=labels, spec={"selector": pods, **spec})
