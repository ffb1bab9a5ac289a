"""Addresses for people: what `service.links` of the components stand for, as a browser opens it."""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple
from urllib.parse import quote

from robotapp_api.model.app.service import ComponentService, Link, ServiceSpec
from robotapp_operator.plan.spec.desired import Desired
from robotapp_operator.plan.spec.objects import Service

MAX_LINKS: Final = 32
"""In the status of one instance."""
FOXGLOVE: Final = "https://app.foxglove.dev/?ds={source}&ds.url={address}"
SOURCES: Final = {"foxglove": "foxglove-websocket", "rosbridge": "rosbridge-websocket"}
"""Schemes that mean Foxglove in the browser → its name for the kind of server."""


class LinkView(NamedTuple):
    """A link of a component, with its address as far as the cluster has given it one."""

    component: str
    name: str
    url: str


def list_links(
    desired: Desired,
    services: Mapping[str, Service],
    nodes: Mapping[str, str],
    address_of: Callable[[str], str],
) -> tuple[LinkView, ...]:
    """Returns the links that have an address, in the order of the spec.

    services: those there are, by name. nodes: where each component runs. address_of: a node's address, "" for none.
    A Service of type ClusterIP has an address for pods of the cluster only; one that waits for its load balancer has none.
    """
    links: list[LinkView] = []
    for component in desired.app.spec.components:
        service = services.get(desired.name_of(component.name))
        if component.service is not None and service is not None:
            node_address = address_of(nodes.get(component.name, ""))
            links += _links_of(component.name, component.service, service, node_address)
    return tuple(links[:MAX_LINKS])


def write_url(scheme: str, address: str, path: str) -> str:
    """Returns the address as a browser opens it. `address` is host and port."""
    if source := SOURCES.get(scheme):
        return FOXGLOVE.format(source=source, address=quote(f"ws://{address}{path}", safe=""))
    return f"{scheme}://{address}{path}"


def _links_of(
    component: str, component_service: ComponentService, service: Service, node_address: str
) -> Iterator[LinkView]:
    for link in component_service.links:
        if address := _find_address(link, component_service.spec, service, node_address):
            yield LinkView(component, link.name, write_url(link.scheme, address, link.path))


def _find_address(link: Link, service_spec: ServiceSpec, service: Service, node_address: str) -> str:
    """Returns host and port of the link; "" while the cluster has given it none."""
    port = next(port for port in service_spec.ports if port.name == link.port)
    match service_spec.type:
        case "NodePort":
            number = next((given.node_port for given in service.ports if given.name == port.name), 0)
            return f"{_bracket(node_address)}:{number}" if node_address and number else ""
        case "LoadBalancer":
            hosts = (entry.ip or entry.hostname for entry in service.status.load_balancer.ingress)
            host = next((host for host in hosts if host), "")
            return f"{_bracket(host)}:{port.port}" if host else ""
        case _:
            return f"{service.metadata.name}.{service.metadata.namespace}.svc:{port.port}"


def _bracket(host: str) -> str:
    return f"[{host}]" if ":" in host else host
