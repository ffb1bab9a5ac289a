"""Which addresses are the node's own."""

import socket
import struct
from pathlib import Path

import pytest

from robotapp_client.serving.node_addresses import LOOPBACK, find_node_addresses, read_host

ROUTES = """\
Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
eth0\t00000000\t{gateway}\t0003\t0\t0\t0\t00000000\t0\t0\t0
eth0\t0000F40A\t00000000\t0001\t0\t0\t0\t0000FFFF\t0\t0\t0
"""
ROUTES_6 = """\
{zero} 00 {zero} 00 fd00000000000000000000000000000a 00000400 00000001 00000000 00000003 eth0
fd000000000000000000000000000000 40 {zero} 00 {zero} 00000100 00000001 00000000 00000001 eth0
{zero} 00 {zero} 00 {zero} ffffffff 00000001 00000000 00200200 lo
"""


def write_tables(net: Path) -> Path:
    number = struct.unpack("=I", socket.inet_aton("10.244.0.1"))[0]
    (net / "route").write_text(ROUTES.format(gateway=f"{number:08X}"))
    (net / "ipv6_route").write_text(ROUTES_6.format(zero="0" * 32))
    return net


def test_they_are_loopback_the_addresses_of_the_chart_and_the_gateways_of_default_routes(tmp_path: Path) -> None:
    environ = {"HOST_IPS": "192.168.1.7,fd01:0:0::7"}
    expected = LOOPBACK | {"192.168.1.7", "fd01::7", "10.244.0.1", "fd00::a"}
    assert find_node_addresses(environ, write_tables(tmp_path)) == expected


def test_without_tables_and_variable_there_is_loopback(tmp_path: Path) -> None:
    assert find_node_addresses({}, tmp_path / "none") == find_node_addresses({"HOST_IPS": ""}, tmp_path) == LOOPBACK


def test_what_is_no_address_is_named_and_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert find_node_addresses({"HOST_IPS": "node-7, 10.0.0.1"}, tmp_path) == LOOPBACK | {"10.0.0.1"}
    assert "HOST_IPS: 'node-7' is no IP address" in caplog.text


@pytest.mark.parametrize(
    ("text", "expected"), [("::ffff:10.0.0.1", "10.0.0.1"), ("FE80::1%eth0", "fe80::1"), ("10.0.0.1", "10.0.0.1")]
)
def test_an_address_is_written_in_one_way(text: str, expected: str) -> None:
    assert read_host(text) == expected
