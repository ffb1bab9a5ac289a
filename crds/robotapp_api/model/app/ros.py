"""Which ROS an app speaks and how its processes find each other: ros, ros2, ros1."""

from typing import Annotated, Final, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model.app.template import HelperContainer
from robotapp_api.model.base import Model
from robotapp_api.model.markers import ListMap, Rule
from robotapp_api.model.scalars import AppName, DomainId, OptionalImage, ShortText

Rmw = Annotated[str, StringConstraints(max_length=63, pattern=r"^rmw_[a-z0-9_]+$")]
DiscoveryMode = Literal["Auto", "Multicast", "Server", "Peers", "Router", "Localhost"]
Isolation = Literal["Domain", "Discovery"]
Transport = Literal["Auto", "UDP", "SHM"]


class Ros(Model):
    """ROS version and distribution."""

    version: Literal[1, 2] | None = None
    """ROS version, 1 or 2; absent means the one the distribution belongs to."""
    distro: Annotated[str, StringConstraints(min_length=1, max_length=32, pattern=r"^[a-z]+$")]
    """ROS distribution in lower case, such as humble, jazzy or noetic; none for an app without ROS."""


class Discovery(HelperContainer):
    """How participants of the domain find each other, and the pods of discovery servers or router."""

    mode: DiscoveryMode = "Auto"
    """Auto chooses Server for Fast DDS, Peers for Cyclone DDS and Router for Zenoh, and nothing for an app with ROS in one pod. Multicast needs a network plug-in
    that carries it; Localhost keeps everything inside the pod."""
    image: OptionalImage = ""
    """Image of the discovery server or router; empty means the operator's for the distribution, and for a router the first
    component's."""


class SharedApp(Model):
    """A RobotApp that is meant to hear this one."""

    namespace: ShortText = ""
    """Namespace of the other RobotApp; empty means this one. Another namespace must name this app in turn."""
    name: AppName
    """Name of the other RobotApp."""


class External(Model):
    """How programs outside of the cluster join the app's domain."""

    expose: Literal["NodePort", "LoadBalancer"]
    """Where the discovery servers or the router are reached: at a port of every node, or at the cluster's load balancer. Takes the
    right to create Services."""


class Ros2(Model):
    """DDS domain, middleware and discovery of a ROS 2 app."""

    RULES = (
        Rule(
            rule="!has(self.domain) || self.allowUnsafeDomain || (self.domain >= 1 && self.domain <= 101) || self.domain >= 215",
            message="domain must be in 1-101 or 215-232; write such a number, leave domain out, or write allowUnsafeDomain: true",
            expression="'domain %d is unsafe: 0 is what everybody uses by default and 102-214 meet Linux ephemeral ports; write 1-101 or 215-232, leave domain out, or write allowUnsafeDomain: true'.format([self.domain])",
            path=".domain",
        ),
        Rule(
            rule="self.isolation != 'Discovery' || self.discovery.mode != 'Multicast'",
            message="isolation Discovery shares a domain, and with Multicast everybody on it hears everybody; write discovery.mode: Auto, Server, Peers or Router, or isolation: Domain",
            path=".discovery.mode",
        ),
    )

    domain: DomainId | None = None
    """ROS_DOMAIN_ID of the app; absent means that each instance gets a free one from the pool."""
    allow_unsafe_domain: bool = False
    """Accept domain 0 (everybody's default) and 102-214 (their ports meet the ephemeral port range of Linux)."""
    pool: AppName = "default"
    """DomainPool the domain comes from."""
    isolation: Isolation = "Domain"
    """Domain gives every instance a domain of its own; Discovery shares one and separates apps by discovery: with discovery Auto, one
    pod with ROS alone stays within itself."""
    rmw: Rmw | None = None
    """ROS middleware implementation, such as rmw_cyclonedds_cpp; absent means the default of the distribution."""
    discovery: Discovery = Discovery()
    """How participants find each other."""
    external: External | None = None
    """Opens the discovery servers or the router to programs outside of the cluster, such as RViz on a laptop."""
    transport: Transport = "Auto"
    """Transport for data: UDP, SHM (shared memory between components on one node), or what the middleware chooses."""
    share_with: Annotated[tuple[SharedApp, ...], ListMap("namespace", "name"), Field(max_length=16)] = ()
    """RobotApps whose domain this app joins on purpose; its own `domain` counts only when it leads apps that name each other."""


_NO_ADDRESS: Final = "an External master needs its address; write uri, for example http://master.default.svc:11311"


class Ros1(HelperContainer):
    """ROS 1 master."""

    RULES = (
        Rule(
            rule="self.master != 'External' || self.uri.startsWith('http://')",
            message=_NO_ADDRESS,
            expression=f"self.uri == '' ? '{_NO_ADDRESS}' : 'uri %s does not begin with http://; write for example http://master.default.svc:11311'.format([self.uri])",
            path=".uri",
        ),
        Rule(
            rule="self.master == 'External' || self.uri == ''",
            message="uri is the address of an External master; drop uri, or write master: External",
            path=".uri",
        ),
    )

    master: Literal["Managed", "External"] = "Managed"
    """Managed runs one roscore per instance; External uses the master at uri."""
    uri: Annotated[str, StringConstraints(max_length=512)] = ""
    """ROS_MASTER_URI of an External master, such as http://master.default.svc:11311."""
    image: OptionalImage = ""
    """Image of the Managed master; empty means the operator's default for the distribution."""
