"""The links of a cluster, as commands for iproute2, and the configuration of the container network. Pure.

host:  robotapp<N>  ── control (bridge, in the hub) ── eth0 of every node: API server, kubelet, DNS
nodes: pods ── cni0 (bridge, in the node) ── data0 ── data (bridge, in the hub), or the latency switch in its place
"""

import json
from typing import Final

from robotapp_testbed.real.config.addresses import POD_BRIDGE, POD_NETWORK, Addresses

HUB_SYSCTLS: Final = {
    "net/ipv6/conf/all/disable_ipv6": "1",
    # Frames between nodes are switched, never filtered by rules of a firewall.
    "net/bridge/bridge-nf-call-iptables": "0",
    "net/bridge/bridge-nf-call-ip6tables": "0",
    "net/bridge/bridge-nf-call-arptables": "0",
}
OUTSIDER_SYSCTLS: Final = {"net/ipv6/conf/all/disable_ipv6": "1"}
NODE_SYSCTLS: Final = {"net/ipv4/ip_forward": "1", "net/ipv6/conf/all/disable_ipv6": "1"}


def hub() -> list[str]:
    """In the hub, before anything is plugged in."""
    return [
        "link set lo up",
        "link add control type bridge",
        "link set control up",
        "link add data type bridge mcast_snooping 0",
        "link set data up",
    ]


def host(addresses: Addresses, *, hub_pid: int) -> list[str]:
    """On the host: the far end of its one link is in the hub, so it goes when the hub goes."""
    name = addresses.host_link
    return [
        f"link add name {name} type veth peer name host netns {hub_pid}",
        f"addr add {addresses.host_ip}/24 dev {name}",
        f"link set {name} up",
    ]


def hub_of_host() -> list[str]:
    return ["link set host master control up"]


def plug(node: int, *, node_pid: int, data: bool) -> list[str]:
    """In the hub: the near ends of a node's links. `data` is False when the latency switch carries the pods' frames."""
    lines = [
        f"link add name control{node} type veth peer name eth0 netns {node_pid}",
        f"link set control{node} master control up",
    ]
    if data:
        lines += [
            f"link add name data{node} type veth peer name data0 netns {node_pid}",
            f"link set data{node} master data up",
        ]
    return lines


def node(addresses: Addresses, index: int, *, data: bool) -> list[str]:
    """In the node. The pod bridge is made before any pod, so that the way out is there when the first one comes."""
    lines = [
        "link set lo up",
        f"addr add {addresses.node_ip(index)}/24 dev eth0",
        "link set eth0 up",
        f"route add default via {addresses.host_ip}",
        f"link add {POD_BRIDGE} address {addresses.bridge_mac(index)} type bridge mcast_snooping 0",
        f"addr add {addresses.pod_gateway(index)}/16 dev {POD_BRIDGE}",
        f"link set {POD_BRIDGE} up",
    ]
    return [*lines, f"link set data0 master {POD_BRIDGE} up"] if data else lines


def plug_outsider(outsider: int, *, outsider_pid: int) -> list[str]:
    """Returns the commands for the hub that join a machine outside of the cluster to the network of the nodes."""
    return [
        f"link add name outside{outsider} type veth peer name eth0 netns {outsider_pid}",
        f"link set outside{outsider} master control up",
    ]


def outsider(addresses: Addresses, index: int, *, nodes: int) -> list[str]:
    """Returns the commands for a machine outside of the cluster, which reaches pods by way of their nodes."""
    routes = [f"route add {addresses.pod_subnet(node)} via {addresses.node_ip(node)}" for node in range(1, nodes + 1)]
    return [f"addr add {addresses.outsider_ip(index)}/24 dev eth0", "link set eth0 up", *routes]


def way_out() -> list[str]:
    """Arguments of iptables in the node: what pods send past the pod network leaves with the node's address."""
    return ["-t", "nat", "-A", "POSTROUTING", "-s", POD_NETWORK, "-o", "eth0", "-j", "MASQUERADE"]


def container_network(addresses: Addresses, index: int) -> str:
    """A CNI configuration list: every node hands out its own part of one flat network."""
    first, last = addresses.pod_range(index)
    ranges = [[{"subnet": POD_NETWORK, "rangeStart": first, "rangeEnd": last, "gateway": addresses.pod_gateway(index)}]]
    bridge = {
        "type": "bridge",
        "bridge": POD_BRIDGE,
        "isGateway": False,
        "ipMasq": False,
        "ipam": {"type": "host-local", "ranges": ranges, "routes": [{"dst": "0.0.0.0/0"}]},
    }
    return json.dumps({"cniVersion": "0.4.0", "name": "pods", "plugins": [bridge]})
