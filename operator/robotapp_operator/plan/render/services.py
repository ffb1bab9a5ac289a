"""Services of an instance: names for components and discovery servers, addresses of other infrastructure, and what components ask for."""

from typing import Any, Final

from robotapp_api.model.app.service import ComponentService, ServicePort
from robotapp_operator.plan.render.child import (
    SERVICE,
    Child,
    component_labels,
    instance_labels,
    replicas_labels,
    role_labels,
    selector,
)
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.links import OUTSIDE
from robotapp_operator.plan.spec.objects import ChildRef
from robotapp_operator.plan.spec.robot_values import expand_labels

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


def outside_service(*, name: str, labels: dict[str, str], port: int, protocol: str, expose: str) -> Child:
    """Opens a discovery server or router to programs outside of the cluster, under a port of nodes or a load balancer."""
    ports = [{"name": OUTSIDE, "port": port, "protocol": protocol, "targetPort": port}]
    return _service(name, labels, selector(labels), {"type": expose, "ports": ports})


def component_services(desired: Desired) -> list[Child]:
    """Services that the components ask for themselves. A suspended app keeps them, and with them their addresses."""
    return [_component_service(desired, component, service) for component, service in desired.app.services.items()]


def replicas_services(desired: Desired) -> list[Child]:
    """Under each of them the replicas of a component have their names, unless they have them among the peers."""
    names = {desired.replicas_service(name): replica.component for name, replica in desired.app.replicas.items()}
    return [
        _names_service(desired, name, replicas_labels(desired, component))
        for name, component in names.items()
        if name != desired.peers_service
    ]


def _component_service(desired: Desired, component: str, service: ComponentService) -> Child:
    has_ordinals = any(replica.component == component for replica in desired.app.replicas.values())
    labels = replicas_labels(desired, component) if has_ordinals else component_labels(desired, component)
    wanted = service.spec
    spec = {
        "type": wanted.type,
        "selector": selector(labels),
        "ports": [_service_port(port) for port in wanted.ports],
        **_written(externalTrafficPolicy=wanted.external_traffic_policy, loadBalancerClass=wanted.load_balancer_class),
        **({"loadBalancerSourceRanges": list(ranges)} if (ranges := wanted.load_balancer_source_ranges) else {}),
    }
    return Child(
        ref=ChildRef(SERVICE, desired.name_of(component)),
        labels=expand_labels(service.metadata.labels, desired.instance_values) | labels,
        annotations=service.metadata.annotations,
        spec=spec,
    )


def _service_port(port: ServicePort) -> dict[str, Any]:
    """The target is always written: without it a change of the port alone would leave the API server's copy of the old one."""
    return {
        "name": port.name,
        "port": port.port,
        "protocol": port.protocol,
        "targetPort": port.target_port or port.port,
        **_written(nodePort=port.node_port, appProtocol=port.app_protocol),
    }


def _written(**fields: object) -> dict[str, Any]:
    return {key: value for key, value in fields.items() if value is not None}
