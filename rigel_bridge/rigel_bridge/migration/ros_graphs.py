"""Which ROS graph a workload was part of before a migration: who of the others its nodes could meet. Pure."""

import re
from dataclasses import dataclass
from typing import Final

from rigel_bridge.document.distros import distros
from rigel_bridge.migration.found import MASTER, Workload
from rigel_bridge.render import scheduling
from rigel_bridge.render.ros import OWN_MASTER

DEFAULT_RMW: Final = "rmw_fastrtps_cpp"
_ZENOH: Final = "rmw_zenoh_cpp"
_ENDPOINT: Final = re.compile(r"(?:tcp|udp|tls|quic|ws)/[^\"',\]\s]+")
_LOOPBACK: Final = ("localhost", "127.0.0.1", "[::1]")
_URI_HOST: Final = re.compile(r"https?://(\[[^\]]*\]|[^:/]+)")
_ALONE: Final = ("LOCALHOST", "OFF")
"""Values of ROS_AUTOMATIC_DISCOVERY_RANGE with which no other pod is heard."""


@dataclass(frozen=True, slots=True)
class RosGraph:
    """What must be equal, or overlap, for the nodes of two workloads to meet."""

    version: int
    domain: str = ""
    """`0`, another number, or the place where a migration cannot read it."""
    brokers: frozenset[str] = frozenset()
    """Discovery servers, Zenoh routers or the master; empty where nodes meet by multicast."""
    zenoh: bool = False

    def __str__(self) -> str:
        """The graph as a report names it."""
        where = "the default domain" if self.domain == "0" else f"domain {self.domain}"
        if self.is_unread:
            where = f"the domain that {self.domain} states"
        names = ", ".join(sorted(self.brokers))
        if self.version == 1:
            return f"the master at {names}"
        return f"{where} with {names}" if names else where

    @property
    def is_unread(self) -> bool:
        """Whether the domain is written where a migration does not read."""
        return bool(self.domain) and not self.domain.isdigit()

    @property
    def number(self) -> int | None:
        """The id that somebody chose; None for the default domain and for one that cannot be read."""
        return int(self.domain) if self.domain.isdigit() and self.domain != "0" else None


def meets(first: RosGraph | None, second: RosGraph | None) -> bool:
    """Returns whether nodes of the two could find each other; clients of a server do not look for others by multicast."""
    if (
        first is None
        or second is None
        or (first.version, first.domain, first.zenoh)
        != (
            second.version,
            second.domain,
            second.zenoh,
        )
    ):
        return False
    return bool(first.brokers & second.brokers) or not (first.brokers or second.brokers)


def distro_of(workload: Workload) -> str:
    """Returns the ROS distribution that ROS_DISTRO or the image names; empty for none."""
    image = str(workload.template["spec"]["containers"][0].get("image", ""))
    words = re.split(r"[^a-z]+", f"{workload.variables.text('ROS_DISTRO')} {image}".lower())
    return next((word for word in words if word in distros()), "")


def graph_of(workload: Workload, *, distro: str = "") -> RosGraph | None:
    """Returns the graph of a workload; None for one whose nodes meet no other pod. `distro` serves one that names none."""
    known = distros().get(distro_of(workload) or distro)
    master = workload.variables.text("ROS_MASTER_URI")
    if (known.version if known else 1 if master else 2) == 1:
        host = _host_of(master)
        return RosGraph(1, brokers=frozenset({master_uri(workload)})) if host and host not in _LOOPBACK else None
    domain = workload.variables.by_name.get("ROS_DOMAIN_ID")
    if _is_alone(workload) or (domain and domain.source.startswith("field ")):
        return None
    if workload.variables.text("RMW_IMPLEMENTATION") == _ZENOH:
        endpoints = frozenset(_ENDPOINT.findall(workload.variables.text("ZENOH_CONFIG_OVERRIDE")))
        return RosGraph(2, domain_of(workload), endpoints, zenoh=True) if endpoints else None
    servers = workload.variables.text("ROS_DISCOVERY_SERVER").split(";")
    return RosGraph(2, domain_of(workload), frozenset(server.strip() for server in servers if server.strip()))


def domain_of(workload: Workload) -> str:
    """Returns the number of the domain, or where it is written when a migration cannot read it."""
    wished = workload.annotations.get("dds-domain", "")
    variable = workload.variables.by_name.get("ROS_DOMAIN_ID")
    if scheduling.DOMAIN.fullmatch(wished):
        return str(int(wished))
    if variable is None:
        return ", ".join(workload.variables.unread) or "0"
    if variable.text is None:
        return variable.source
    return str(int(variable.text)) if scheduling.DOMAIN.fullmatch(variable.text.strip()) else "0"


def asks_for_own_domain(workload: Workload) -> bool:
    """Returns whether the annotation asks for a domain that nobody else has, though no variable carries one to the processes."""
    return workload.annotations.get("dds-domain") == "auto" and "ROS_DOMAIN_ID" not in workload.variables.by_name


def uses_own_master(workload: Workload) -> bool:
    """Returns whether a workload of ROS 1 uses the master that the apps of its namespace share, or one on its own machine."""
    uri = workload.variables.text("ROS_MASTER_URI")
    return bool(OWN_MASTER.fullmatch(uri)) and (*_host_of(uri).split("."), workload.namespace)[1] == workload.namespace


def master_uri(workload: Workload) -> str:
    """Returns the address of the workload's master as every namespace reaches it."""
    uri = workload.variables.text("ROS_MASTER_URI")
    labels = (*_host_of(uri).split("."), workload.namespace)
    return f"http://{MASTER}.{labels[1]}:11311" if labels[0] == MASTER else uri.rstrip("/")


def is_ros(workload: Workload) -> bool:
    """Returns whether a workload that is not migrated has nodes: ROS variables or an image of a distribution, and no broker."""
    container = workload.template["spec"]["containers"][0]
    program = " ".join(str(word) for key in ("command", "args") for word in container.get(key) or ())
    broker = any(word in program for word in ("fastdds", "fast-discovery-server", "zenohd", "roscore"))
    return bool(workload.variables.by_name or distro_of(workload)) and not broker and workload.name != MASTER


def _is_alone(workload: Workload) -> bool:
    local = workload.variables.text("ROS_LOCALHOST_ONLY") == "1"
    return local or workload.variables.text("ROS_AUTOMATIC_DISCOVERY_RANGE").upper() in _ALONE


def _host_of(uri: str) -> str:
    match = _URI_HOST.match(uri)
    return match.group(1) if match else ""
