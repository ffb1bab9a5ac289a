"""How others reach a component: a Service per instance, and addresses for people."""

from typing import Annotated, Any, Final, Literal

from pydantic import Field, StringConstraints, WithJsonSchema

from robotapp_api.model.app.template import TemplateMetadata
from robotapp_api.model.base import Model
from robotapp_api.model.markers import ListMap, ListSet, Rule
from robotapp_api.model.patterns import LABEL_PATTERN
from robotapp_api.model.scalars import DnsLabel

ServiceType = Literal["ClusterIP", "NodePort", "LoadBalancer"]
LinkScheme = Literal["http", "https", "ws", "wss", "foxglove", "rosbridge"]
PortNumber = Annotated[int, Field(ge=1, le=65_535)]
PORT_NAME: Final = LABEL_PATTERN
PortName = Annotated[str, StringConstraints(min_length=1, max_length=15, pattern=PORT_NAME)]
_PORT_SCHEMA: Final[dict[str, Any]] = {
    "x-kubernetes-int-or-string": True,
    "anyOf": [{"type": "integer"}, {"type": "string"}],
    "minimum": 1,
    "maximum": 65_535,
    "minLength": 1,
    "maxLength": 15,
    "pattern": PORT_NAME,
}
LINK_PATH: Final = r"^(/[-A-Za-z0-9._~!$&'()*+,;=:@%/?#]*)?$"
LinkPath = Annotated[str, StringConstraints(max_length=256, pattern=LINK_PATH)]


class ServicePort(Model):
    """One port of the Service, with core's names."""

    name: PortName
    """Name of the port."""
    port: PortNumber
    """Port of the Service."""
    protocol: Literal["TCP", "UDP", "SCTP"] = "TCP"
    """Transport protocol."""
    target_port: Annotated[PortNumber | PortName, WithJsonSchema(_PORT_SCHEMA)] | None = None
    """Port of the container, its number or its name in `ports`; absent means the number of `port`."""
    node_port: PortNumber | None = None
    """Port on every node, with type NodePort or LoadBalancer; absent means that the cluster chooses one."""
    app_protocol: Annotated[str, StringConstraints(min_length=1, max_length=253)] | None = None
    """Protocol spoken on the port, for Gateways and meshes, such as kubernetes.io/ws."""


class ServiceSpec(Model):
    """The Service, with core's names. Its pods are chosen by the operator."""

    RULES = (
        Rule(
            rule="self.type != 'ClusterIP' || self.ports.all(p, !has(p.nodePort))",
            message="nodePort needs a port on every node; write type: NodePort, or leave nodePort out",
            path=".ports",
        ),
        Rule(
            rule="self.type == 'LoadBalancer' || (!has(self.loadBalancerClass) && !has(self.loadBalancerSourceRanges))",
            message="loadBalancerClass and loadBalancerSourceRanges need type: LoadBalancer; write that type, or leave them out",
        ),
        Rule(
            rule="self.type != 'ClusterIP' || !has(self.externalTrafficPolicy)",
            message="externalTrafficPolicy needs type: NodePort or LoadBalancer; write one of them, or leave it out",
        ),
    )

    type: ServiceType = "ClusterIP"
    """Who reaches it: ClusterIP, pods of the cluster; NodePort, whoever reaches a node; LoadBalancer, whoever the cluster's load
    balancer serves. The last two take the right to create Services."""
    ports: Annotated[tuple[ServicePort, ...], ListMap("name"), Field(min_length=1, max_length=16)]
    """Ports of the Service."""
    external_traffic_policy: Literal["Cluster", "Local"] | None = None
    """Whether nodes without a pod forward traffic from outside: Cluster, or Local, which keeps the sender's address."""
    load_balancer_class: Annotated[str, StringConstraints(min_length=1, max_length=253)] | None = None
    """Which load balancer serves it, such as example.com/internal."""
    load_balancer_source_ranges: Annotated[
        tuple[Annotated[str, StringConstraints(max_length=64)], ...], ListSet(), Field(max_length=16)
    ] = ()
    """Networks whose traffic is admitted, such as 10.0.0.0/8."""


class Link(Model):
    """An address for people."""

    name: DnsLabel
    """What is there, such as map or console."""
    port: PortName
    """Name of a port of the Service."""
    scheme: LinkScheme = "http"
    """http, https, ws or wss; foxglove and rosbridge: Foxglove in the browser, connected to the port."""
    path: LinkPath = ""
    """Path behind the address, such as /vnc.html."""


class ComponentService(Model):
    """A Service of the component's pods, one per instance; it ends with the app or when this field is removed."""

    RULES = (
        Rule(
            rule="!has(self.links) || self.links.all(l, self.spec.ports.exists(p, p.name == l.port))",
            message="a link names a port that service.spec.ports does not have; write the name of one of its ports",
            expression="'link %s names the port %s, which service.spec.ports does not have; write the name of one of its ports'.format([self.links.filter(l, !self.spec.ports.exists(p, p.name == l.port))[0].name, self.links.filter(l, !self.spec.ports.exists(p, p.name == l.port))[0].port])",
            path=".links",
        ),
    )

    metadata: TemplateMetadata = Field(default_factory=TemplateMetadata)
    """Labels and annotations of the Service; annotations take the right to create Services, since programs obey them."""
    spec: ServiceSpec
    """Type and ports."""
    links: Annotated[tuple[Link, ...], ListMap("name"), Field(max_length=8)] = ()
    """Addresses for people, shown in the status of each instance and opened by `kubectl robotapp open`."""
