"""The texts and documents the programs of a node are started with."""

import ipaddress
import json
import tomllib
from pathlib import Path

import pytest

from robotapp_testbed.control_plane.components import SERVICE_NETWORK
from robotapp_testbed.real.config import containerd, kubelet, network, services
from robotapp_testbed.real.config.addresses import API_SERVICE_IP, DNS_SERVICE_IP, POD_BRIDGE, Addresses

ADDRESSES = Addresses(3)


@pytest.mark.parametrize("may", [True, False])
def test_runc_sets_oom_scores_only_where_it_may(may: bool) -> None:
    text = containerd.configuration(
        root=Path("/run/x"), cni_bin=Path("/cni"), cni_conf=Path("/conf"), privileged_oom=may
    )
    cri = tomllib.loads(text)["plugins"]["io.containerd.grpc.v1.cri"]
    assert cri["restrict_oom_score_adj"] is not may
    assert cri["sandbox_image"] == "localhost/robotapp-pause:testbed"


def test_containerd_keeps_everything_in_its_root_or_in_run() -> None:
    text = containerd.configuration(
        root=Path("/r"), cni_bin=Path("/r/cni"), cni_conf=Path("/r/conf"), privileged_oom=True
    )
    paths = [line.partition('"')[2].rstrip('"') for line in text.splitlines() if ' = "/' in line]
    assert paths
    assert all(path.startswith(("/r", "/run/containerd")) for path in paths)


def test_a_kubelet_lives_in_its_own_control_group_and_asks_the_cluster_who_may_enter() -> None:
    config = kubelet.configuration(
        cgroup="robotapp-nodes-3/edge-1", certificate=Path("/c"), key=Path("/k"), client_ca=Path("/ca")
    )
    assert config["cgroupRoot"] == "/robotapp-nodes-3/edge-1"
    assert config["authentication"]["anonymous"] == {"enabled": False}
    assert config["authorization"] == {"mode": "Webhook"}
    assert config["clusterDNS"] == [DNS_SERVICE_IP]


def test_labels_are_given_on_the_command_line() -> None:
    def command(labels: dict[str, str]) -> list[str]:
        return kubelet.command(
            Path("/kubelet"), config=Path("/c"), kubeconfig=Path("/k"), name="a", address="1.2.3.4", labels=labels
        )

    assert "--node-labels=tier=edge,zone=hall" in command({"tier": "edge", "zone": "hall"})
    assert not any("labels" in argument for argument in command({}))


@pytest.mark.parametrize("data", [True, False])
def test_the_plain_bridge_is_left_out_where_the_switch_carries_the_frames(data: bool) -> None:
    lines = [*network.plug(2, node_pid=77, data=data), *network.node(ADDRESSES, 2, data=data)]
    assert any("data" in line for line in lines) is data
    assert f"addr add {ADDRESSES.node_ip(2)}/24 dev eth0" in lines
    assert any(line.startswith(f"link add {POD_BRIDGE} address 02:00:0a:f4:02:01") for line in lines)


def test_the_only_link_of_the_host_ends_in_the_hub() -> None:
    created = [line for line in network.host(ADDRESSES, hub_pid=42) if line.startswith("link add")]
    assert created == ["link add name robotapp3 type veth peer name host netns 42"]


def test_pods_of_a_node_get_its_part_of_the_pod_network() -> None:
    (plugin,) = json.loads(network.container_network(ADDRESSES, 4))["plugins"]
    assert plugin["bridge"] == POD_BRIDGE
    assert plugin["ipam"]["ranges"][0][0] == {
        "subnet": "10.244.0.0/16",
        "rangeStart": "10.244.4.10",
        "rangeEnd": "10.244.4.250",
        "gateway": "10.244.4.1",
    }


@pytest.mark.parametrize("filtered", [True, False])
def test_clients_of_services_are_hidden_only_where_answers_would_get_lost(filtered: bool) -> None:
    config = services.proxy_configuration(kubeconfig=Path("/k"), node="a", bridged_traffic_is_filtered=filtered)
    assert config["iptables"]["masqueradeAll"] is not filtered
    assert config["conntrack"] == {"maxPerCore": 0, "min": 0}


def test_the_cluster_has_dns_at_the_usual_address() -> None:
    kinds = {each["kind"]: each for each in services.dns_objects("198.18.3.1")}
    assert kinds["Service"]["spec"]["clusterIP"] == DNS_SERVICE_IP
    assert "selector" not in kinds["Service"]["spec"]
    assert kinds["EndpointSlice"]["endpoints"][0]["addresses"] == ["198.18.3.1"]
    network = ipaddress.ip_network(SERVICE_NETWORK)
    assert ipaddress.ip_address(API_SERVICE_IP) == network[1], "kube-apiserver takes the first one"
    assert ipaddress.ip_address(DNS_SERVICE_IP) in network
    assert "bind 198.18.3.1" in services.corefile(address="198.18.3.1", kubeconfig=Path("/k"), ready_port=1)
