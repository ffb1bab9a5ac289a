"""Addresses from which the node itself reaches a port: probes of the kubelet, `kubectl port-forward`.

Whoever floods a port from many addresses must not keep these out. They are the node's addresses, which the chart gives to the
container; the pod's default gateways, from which the node reaches its pods with most network plugins; and loopback.
"""

import ipaddress
import logging
import os
import socket
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

log = logging.getLogger(__name__)

VARIABLE: Final = "HOST_IPS"
"""Addresses of the node with commas between, as the downward API writes `status.hostIPs`."""
LOOPBACK: Final = frozenset({"127.0.0.1", "::1"})
NET: Final = Path("/proc/net")
_ANYWHERE: Final = {"route": "00000000", "ipv6_route": "0" * 32}
"""How the kernel writes the destination of a default route, by the name of its table (proc_net(5))."""


def find_node_addresses(environ: Mapping[str, str] = os.environ, net: Path = NET) -> frozenset[str]:
    """Returns the addresses as `read_host` writes them. What cannot be read is left out."""
    return LOOPBACK | {*_read_variable(environ)} | {*_read_gateways(net)}


def read_host(text: str) -> str:
    """Returns the one way to write an address: IPv4 also where IPv6 carries it, without a zone. Raises ValueError for none."""
    address = ipaddress.ip_address(text.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(address)


def _read_variable(environ: Mapping[str, str]) -> Iterator[str]:
    for text in filter(None, map(str.strip, environ.get(VARIABLE, "").split(","))):
        try:
            yield read_host(text)
        except ValueError:
            log.warning(
                "%s: %.80r is no IP address; addresses of the node are expected, with commas between", VARIABLE, text
            )


def _read_gateways(net: Path) -> Iterator[str]:
    """Yields the gateways of default routes."""
    for fields in _read_table(net / "route"):
        if len(fields) > 2 and fields[1] == _ANYWHERE["route"]:
            yield socket.inet_ntoa(struct.pack("=I", int(fields[2], 16)))
    for fields in _read_table(net / "ipv6_route"):
        if len(fields) > 4 and fields[:2] == [_ANYWHERE["ipv6_route"], "00"] and fields[4] != _ANYWHERE["ipv6_route"]:
            yield read_host(socket.inet_ntop(socket.AF_INET6, bytes.fromhex(fields[4])))


def _read_table(path: Path) -> list[list[str]]:
    try:
        return [line.split() for line in path.read_text().splitlines()]
    except OSError:  # a kernel without IPv6 has no table of it
        return []
