"""The ROS environment of a component: domain, middleware and discovery variables; in ROS 1 the master and an address others can reach.

Facts (reference: ROS 2 and vendor documentation). Multicast does not cross most pod networks, so `Auto` never means
multicast for a known middleware. `ROS_LOCALHOST_ONLY` is the switch up to Humble, `ROS_AUTOMATIC_DISCOVERY_RANGE` since
Iron, where a leftover `ROS_LOCALHOST_ONLY=1` would win over everything else.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from robotapp_api.checks.discovery_variables import is_joined, join_values
from robotapp_api.checks.middleware import BEFORE_IRON, CONNEXT, CYCLONE, CYCLONE_11, FAST_DDS
from robotapp_api.model.distros import IPV6
from robotapp_claims.rules.objects import ROS_DOMAIN_ID
from robotapp_operator.plan.spec.desired import Desired, EnvVar

DISCOVERY_SERVER_PORT: Final = 11811
ZENOH_PORT: Final = 7447
MASTER_PORT: Final = 11311
CYCLONE_MAX_INDEX: Final = 32
"""Highest index of a ROS process in a pod, as rmw_cyclonedds_cpp sets it by itself; every peer is probed on so many ports and one.

A process beyond it ends at its start. A component raises it by a `CYCLONEDDS_URI` of its own, which is joined.
"""
_OWN_PREFIX: Final = "ROBOTAPP_OWN_"
"""Begins the name under which a value from a ConfigMap or Secret is kept, so that the joined one can refer to it."""


def ros2_environment(desired: Desired, *, domain: int, shares_memory: bool = True) -> list[EnvVar]:
    """Returns the variables of a ROS 2 container of an instance, in a fixed order.

    shares_memory: false for a pod that Fast DDS takes for the host of others with which it shares no memory.
    """
    variables = {ROS_DOMAIN_ID: str(domain), "RMW_IMPLEMENTATION": desired.rmw}
    variables |= _discovery_range(desired)
    variables |= _discovery(desired)
    variables |= _transport(desired, shares_memory=shares_memory)
    return [EnvVar(name, value) for name, value in variables.items()]


def join_environment(ours: Sequence[dict[str, Any]], own: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Returns a container's variables: the operator's first, then its own, which win or are joined with the operator's."""
    operator_values = {variable["name"]: variable.get("value") for variable in ours}
    own_names = {variable["name"] for variable in own}
    kept = [variable for variable in ours if variable["name"] not in own_names]
    return [*kept, *(entry for variable in own for entry in _own_entries(variable, operator_values))]


def _own_entries(variable: Mapping[str, Any], operator_values: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yields one variable of the container, or the two of which a joined one consists if its value stands elsewhere."""
    name = variable["name"]
    ours = operator_values.get(name)
    if ours is None or not is_joined(variable):
        yield {**variable}
    elif "valueFrom" in variable:
        kept_name = f"{_OWN_PREFIX}{name}"
        yield {**variable, "name": kept_name}
        yield {"name": name, "value": join_values(name, ours, f"$({kept_name})")}
    else:
        yield {"name": name, "value": join_values(name, ours, variable.get("value", ""))}


def _discovery_range(desired: Desired) -> dict[str, str]:
    local = desired.discovery == "Localhost"
    if desired.distro in BEFORE_IRON:
        return {"ROS_LOCALHOST_ONLY": "1" if local else "0"}
    return {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST" if local else "SUBNET"}


def _discovery(desired: Desired) -> dict[str, str]:
    match desired.discovery:
        case "Server":
            return {
                "ROS_DISCOVERY_SERVER": ";".join(f"{name}:{DISCOVERY_SERVER_PORT}" for name in desired.server_names)
            }
        case "Router":
            endpoint = f'mode="client";connect/endpoints=["tcp/{desired.router_name}:{ZENOH_PORT}"]'
            # 0 = wait for the router: a session that starts without one would join the graph at an unknown time.
            return {"ZENOH_CONFIG_OVERRIDE": endpoint, "ZENOH_ROUTER_CHECK_ATTEMPTS": "0"}
        case "Peers" if desired.rmw in CYCLONE:
            transport = "udp6" if _is_ipv6(desired) else ""
            return {"CYCLONEDDS_URI": cyclone_config(desired.peer_names, distro=desired.distro, transport=transport)}
        case "Peers" if desired.rmw in CONNEXT:
            return {"NDDS_DISCOVERY_PEERS": ",".join(f"udpv4://{peer}" for peer in desired.peer_names)}
        case "Peers":
            return {"ROS_STATIC_PEERS": ";".join(desired.peer_names)}
        case _:
            return {}


def cyclone_config(peers: Sequence[str], *, distro: str, transport: str = "") -> str:
    """Inline Cyclone DDS configuration: unicast discovery towards `peers`.

    One DNS name per component, because Cyclone takes only the first address a name resolves to. From 11 on Cyclone stops
    asking peers that did not answer for 30 s, for good: pods that start while their link is cut would never meet.
    transport: `udp6` where names have IPv6 addresses alone, which end a process that speaks IPv4 at its start.
    """
    prune_delay = "<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay>" if distro in CYCLONE_11 else ""
    general = "<AllowMulticast>false</AllowMulticast>" + (f"<Transport>{transport}</Transport>" if transport else "")
    names = "".join(f"<Peer Address={quoteattr(peer)}/>" for peer in peers)
    return (
        f'<CycloneDDS><Domain Id="any"><General>{general}</General>'
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{CYCLONE_MAX_INDEX}</MaxAutoParticipantIndex>"
        f"{prune_delay}<Peers>{names}</Peers></Discovery></Domain></CycloneDDS>"
    )


def _transport(desired: Desired, *, shares_memory: bool) -> dict[str, str]:
    """UDP alone where the app requires it or the pod cannot do otherwise.

    Fast DDS takes processes with the same network interfaces for one host and sends to them by shared memory. Pods in their node's
    network with a /dev/shm each would list each other's topics and receive nothing.
    With IPv6 always: Fast DDS speaks IPv4 by itself, and takes all pods for one host whose addresses are IPv6 alone.
    """
    if desired.rmw not in FAST_DDS:
        return {}
    if _is_ipv6(desired) and desired.discovery != "Localhost":
        return {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv6"}
    return {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"} if desired.transport == "UDP" or not shares_memory else {}


def _is_ipv6(desired: Desired) -> bool:
    return desired.app.helper_defaults.ip_family == IPV6


# ROS 1


def master_uri(desired: Desired) -> str:
    """Address of the instance's master: our roscore's Service, or what the user wrote."""
    if desired.app.spec.ros1 and not desired.app.managed_master:
        return desired.app.spec.ros1.uri
    return f"http://{desired.master_name}:{MASTER_PORT}"


def ros1_environment(desired: Desired) -> list[dict[str, Any]]:
    """TCPROS peers connect to the address a node advertises, so that must be the pod's own IP, never its host name."""
    return [{"name": "ROS_MASTER_URI", "value": master_uri(desired)}, own_address()]


def own_address() -> dict[str, Any]:
    """The variable with which a ROS 1 process advertises its pod's IP."""
    return {"name": "ROS_IP", "valueFrom": {"fieldRef": {"fieldPath": "status.podIP"}}}
