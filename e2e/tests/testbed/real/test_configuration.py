"""Programs of a node keep to its folders, its control group and its network."""

from pathlib import Path

from robotapp_testbed.real.config import containerd, kubelet, network
from robotapp_testbed.real.config.addresses import DNS_SERVICE_IP, Addresses

ADDRESSES = Addresses(3)


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


def test_the_only_link_of_the_host_ends_in_the_hub() -> None:
    created = [line for line in network.host(ADDRESSES, hub_pid=42) if line.startswith("link add")]
    assert created == ["link add name robotapp3 type veth peer name host netns 42"]


def test_a_machine_outside_reaches_the_pods_of_each_node_by_way_of_that_node() -> None:
    ours = Addresses(3)
    lines = network.outsider(ours, 1, nodes=2)
    assert lines[0] == f"addr add {ours.outsider_ip(1)}/24 dev eth0"
    assert lines[2:] == [f"route add 10.244.{node}.0/24 via {ours.node_ip(node)}" for node in (1, 2)]
    node_addresses = {ours.node_ip(node) for node in range(1, 201)}
    assert not node_addresses & {ours.outsider_ip(index) for index in range(1, 21)}
