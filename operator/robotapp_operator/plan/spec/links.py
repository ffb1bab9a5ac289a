"""Addresses for people: what `service.links` and `ros2.external` stand for, as a browser or another program takes them."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

from robotapp_api.model.app.service import ComponentService
from robotapp_api.model.names import Label
from robotapp_api.values.links import write_url
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.objects import Service

MAX_LINKS: Final = 32
"""In the status of one instance."""
MAX_URL: Final = 1024
"""What the status has room for; one too many characters would have the whole status refused."""
OUTSIDE: Final = "outside"
"""Name of the port, and of the link, of a discovery server or router that programs outside of the cluster reach."""


class LinkView(NamedTuple):
    """A link of a component or helper, with its address as far as the cluster has given it one."""

    component: str
    name: str
    url: str


def list_links(
    desired: Desired,
    services: Mapping[str, Service],
    nodes: Mapping[str, str],
    address_of: Callable[[str], str],
) -> tuple[LinkView, ...]:
    """Returns the links that have an address, in the order of the spec, and those of discovery servers or router.

    services: those there are, by name. nodes: where each component runs. address_of: a node's address, "" for none.
    A Service of type ClusterIP has an address for pods of the cluster only; one that waits for its load balancer has none.
    """
    links: list[LinkView] = []
    for component, component_service in desired.app.services.items():
        service = services.get(desired.name_of(component))
        if service is not None:
            places = (node for name, node in nodes.items() if desired.app.written_name(name) == component)
            links += _links_of(component, component_service, service, address_of(next(places, "")))
    # A port of all nodes is shown at a node where a component runs: helpers may move.
    any_address = next((address for node in nodes.values() if (address := address_of(node))), "")
    helper_services = [services[name] for name in sorted(services) if services[name].metadata.labels.get(Label.ROLE)]
    links += _outside_links(helper_services, any_address)
    # The list is a map by both names. A component may be named like a helper.
    unique_links = {(link.component, link.name): link for link in reversed(links) if len(link.url) <= MAX_URL}
    return tuple(link for link in links if link is unique_links.get((link.component, link.name)))[:MAX_LINKS]


def _links_of(
    component: str, component_service: ComponentService, service: Service, node_address: str
) -> Iterator[LinkView]:
    for link in component_service.links:
        if address := _find_address(service, link.port, node_address):
            yield LinkView(component, link.name, write_url(link.scheme, address, link.path))


def _outside_links(services: list[Service], node_address: str) -> Iterator[LinkView]:
    for service in services:
        labels = service.metadata.labels
        part = "-".join(filter(None, (labels[Label.ROLE], labels.get(Label.PART))))
        if any(port.name == OUTSIDE for port in service.ports) and (
            address := _find_address(service, OUTSIDE, node_address)
        ):
            yield LinkView(part, OUTSIDE, address)


def _find_address(service: Service, port_name: str, node_address: str) -> str:
    """Returns host and port of a port of a Service as it is stored; "" while the cluster has given it no address."""
    port = next((port for port in service.ports if port.name == port_name), None)
    if port is None:  # of a spec that is not written yet
        return ""
    match service.type:
        case "NodePort":
            return f"{_bracket(node_address)}:{port.node_port}" if node_address and port.node_port else ""
        case "LoadBalancer":
            hosts = (entry.ip or entry.hostname for entry in service.status.load_balancer.ingress)
            host = next((host for host in hosts if host), "")
            return f"{_bracket(host)}:{port.port}" if host else ""
        case _:
            return f"{service.metadata.name}.{service.metadata.namespace}.svc:{port.port}"


def _bracket(host: str) -> str:
    return f"[{host}]" if ":" in host else host
