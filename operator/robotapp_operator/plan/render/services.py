"""Services of an instance: names for its components or discovery servers, stable addresses of its other infrastructure."""

from typing import Any, Final

from robotapp_operator.plan.render.child import SERVICE, Child, instance_labels, role_labels, selector
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.objects import ChildRef

DISCOVERY: Final = "discovery"


def peers_service(desired: Desired) -> Child:
    """Under it each component's host name resolves."""
    return _names_service(desired, desired.peers_service, instance_labels(desired))


def servers_service(desired: Desired) -> Child:
    """Under it each discovery server's host name resolves.

    One for all servers: with a Service of its own each would cost the API server two objects more and their updates.
    """
    return _names_service(desired, desired.servers_service, role_labels(desired, DISCOVERY))


def _names_service(desired: Desired, name: str, pods: dict[str, str]) -> Child:
    """Headless: a name per pod, published before it is ready, because discovery happens while starting."""
    kind = {"clusterIP": "None", "publishNotReadyAddresses": True}
    return _service(name, instance_labels(desired), selector(pods), kind)


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
