"""Services and names inside the cluster: kube-proxy on every node, CoreDNS behind the usual address. Pure."""

from pathlib import Path
from typing import Any, Final

from robotapp_testbed.real.config.addresses import CLUSTER_DOMAIN, DNS_SERVICE_IP, POD_NETWORK

PROXY_USER: Final = "system:kube-proxy"
"""The built-in role of node proxies is bound to this user name."""
DNS_USER: Final = "system:serviceaccount:kube-system:coredns"
_SYSTEM = "kube-system"


def proxy_configuration(*, kubeconfig: Path, node: str, bridged_traffic_is_filtered: bool) -> dict[str, Any]:
    """`bridged_traffic_is_filtered`: br_netfilter works, so answers that stay on the pod bridge are translated back.

    Without it a Service's clients are hidden behind their node's address, which sends the answers through the node.
    """
    return {
        "apiVersion": "kubeproxy.config.k8s.io/v1alpha1",
        "kind": "KubeProxyConfiguration",
        "mode": "iptables",
        "hostnameOverride": node,
        "clientConnection": {"kubeconfig": str(kubeconfig)},
        "clusterCIDR": POD_NETWORK,
        "conntrack": {"maxPerCore": 0, "min": 0},  # a limit of the whole machine
        "iptables": {"masqueradeAll": not bridged_traffic_is_filtered, "minSyncPeriod": "100ms", "syncPeriod": "30s"},
        "oomScoreAdj": 0,
    }


def corefile(*, address: str, kubeconfig: Path, ready_port: int) -> str:
    """CoreDNS for the cluster's own names; every other name is refused at once."""
    return f"""\
{CLUSTER_DOMAIN}:53 in-addr.arpa:53 ip6.arpa:53 {{
    bind {address}
    ready 127.0.0.1:{ready_port}
    errors
    kubernetes {CLUSTER_DOMAIN} in-addr.arpa ip6.arpa {{
        kubeconfig {kubeconfig}
        ttl 5
    }}
}}
"""


def dns_objects(address: str) -> list[dict[str, Any]]:
    """The kube-dns Service in front of CoreDNS at `address`, and what CoreDNS may read."""
    meta = {"name": "kube-dns", "namespace": _SYSTEM, "labels": {"k8s-app": "kube-dns"}}
    ports = [{"name": "dns", "port": 53, "protocol": "UDP"}, {"name": "dns-tcp", "port": 53, "protocol": "TCP"}]
    slice_labels = {"kubernetes.io/service-name": "kube-dns"}
    return [
        {
            "apiVersion": "rbac.authorization.k8s.io/v1",
            "kind": "ClusterRole",
            "metadata": {"name": "system:coredns"},
            "rules": [
                {"apiGroups": [""], "resources": ["services", "pods", "namespaces"], "verbs": ["list", "watch"]},
                {"apiGroups": ["discovery.k8s.io"], "resources": ["endpointslices"], "verbs": ["list", "watch"]},
            ],
        },
        {
            "apiVersion": "rbac.authorization.k8s.io/v1",
            "kind": "ClusterRoleBinding",
            "metadata": {"name": "system:coredns"},
            "roleRef": {"apiGroup": "rbac.authorization.k8s.io", "kind": "ClusterRole", "name": "system:coredns"},
            "subjects": [{"kind": "User", "apiGroup": "rbac.authorization.k8s.io", "name": DNS_USER}],
        },
        {
            "apiVersion": "v1",
            "kind": "Service",
            "metadata": meta,
            "spec": {"clusterIP": DNS_SERVICE_IP, "ports": ports},
        },
        {
            "apiVersion": "discovery.k8s.io/v1",
            "kind": "EndpointSlice",
            "metadata": {"name": "kube-dns-host", "namespace": _SYSTEM, "labels": slice_labels},
            "addressType": "IPv4",
            "ports": ports,
            "endpoints": [{"addresses": [address], "conditions": {"ready": True}}],
        },
    ]
