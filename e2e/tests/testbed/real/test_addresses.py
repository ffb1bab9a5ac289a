import ipaddress

from hypothesis import given
from hypothesis import strategies as st

from robotapp_testbed.real.config.addresses import CLUSTERS, NODES, Addresses

clusters = st.integers(0, CLUSTERS - 1)
nodes = st.integers(1, NODES)


@given(clusters, nodes, clusters, nodes)
def test_no_two_nodes_of_the_machine_share_an_address(cluster: int, node: int, other: int, its: int) -> None:
    same = (cluster, node) == (other, its)
    assert (Addresses(cluster).node_ip(node) == Addresses(other).node_ip(its)) == same
    assert Addresses(cluster).host_ip != Addresses(other).node_ip(its)


@given(clusters, nodes)
def test_control_addresses_are_of_the_networks_set_aside_for_tests(cluster: int, node: int) -> None:
    reserved = ipaddress.ip_network("198.18.0.0/15")
    addresses = Addresses(cluster)
    assert ipaddress.ip_address(addresses.host_ip) in reserved
    assert ipaddress.ip_address(addresses.node_ip(node)) in reserved
    assert len(addresses.host_link) <= 15  # IFNAMSIZ
