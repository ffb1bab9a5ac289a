"""Names and addresses of one cluster of real nodes, all derived from its number. Pure.

Only the control network is seen by the host, so only it depends on the number. Pods live inside the namespaces of their
cluster: every cluster has the same pod and Service networks, as clusters elsewhere have.
"""

from dataclasses import dataclass
from typing import Final

POD_NETWORK: Final = "10.244.0.0/16"
API_SERVICE_IP: Final = "10.96.0.1"
DNS_SERVICE_IP: Final = "10.96.0.10"
CLUSTER_DOMAIN: Final = "cluster.local"
POD_BRIDGE: Final = "cni0"
CLUSTERS: Final = 250
NODES: Final = 200
_FIRST_NODE = 10
_FIRST_OUTSIDER = 220


@dataclass(frozen=True, slots=True)
class Addresses:
    """`cluster` is from 0 to 249, the `node` of the methods from 1 to 200."""

    cluster: int

    @property
    def host_link(self) -> str:
        """The one link in the host's own network namespace."""
        return f"robotapp{self.cluster}"

    @property
    def host_ip(self) -> str:
        """Where the API server and the cluster's DNS listen. 198.18.0.0/15 is set aside for test networks (RFC 2544)."""
        return f"198.18.{self.cluster}.1"

    def outsider_ip(self, outsider: int) -> str:
        """Address of a machine that is no node, numbered from 1, on the network of the nodes."""
        return f"198.18.{self.cluster}.{_FIRST_OUTSIDER + outsider}"

    @property
    def cgroup(self) -> str:
        """Below every cgroup hierarchy's root; has one folder per node."""
        return f"robotapp-nodes-{self.cluster}"

    def node_ip(self, node: int) -> str:
        return f"198.18.{self.cluster}.{_FIRST_NODE + node}"

    def node_cgroup(self, name: str) -> str:
        return f"{self.cgroup}/{name}"

    @staticmethod
    def pod_gateway(node: int) -> str:
        return f"10.244.{node}.1"

    @staticmethod
    def pod_subnet(node: int) -> str:
        """Covers the pods of one node, for a route to them."""
        return f"10.244.{node}.0/24"

    @staticmethod
    def pod_range(node: int) -> tuple[str, str]:
        return f"10.244.{node}.10", f"10.244.{node}.250"

    @staticmethod
    def bridge_mac(node: int) -> str:
        """Fixed: a bridge without one takes that of its ports, and it would change under the pods' feet."""
        return f"02:00:0a:f4:{node:02x}:01"
