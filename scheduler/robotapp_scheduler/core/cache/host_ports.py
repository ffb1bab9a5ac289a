"""Host ports in use, by (protocol, port): few nodes have any, so a question touches only those."""

from collections.abc import Iterable

import numpy as np

from robotapp_scheduler.core.nodes.columns import BoolArray
from robotapp_scheduler.core.pods.pod_signature import ANY_IP, HostPort


def clash(one: HostPort, other: HostPort) -> bool:
    """May the two not be used on one node? The wildcard address clashes with every address."""
    if (one.protocol, one.port) != (other.protocol, other.port):
        return False
    return one.ip == other.ip or ANY_IP in {one.ip, other.ip}


class PortUsers:
    """Counts of users per (protocol, port), row and address."""

    def __init__(self) -> None:
        self._users: dict[tuple[str, int], dict[int, dict[str, int]]] = {}

    def __repr__(self) -> str:
        return f"PortUsers({len(self._users)} ports)"

    def count(self, row: int, ports: Iterable[HostPort], sign: int) -> None:
        """Count a pod's ports in (+1) or out (-1)."""
        for port in ports:
            rows = self._users.setdefault((port.protocol, port.port), {})
            addresses = rows.setdefault(row, {})
            addresses[port.ip] = addresses.get(port.ip, 0) + sign
            if addresses[port.ip] <= 0:
                del addresses[port.ip]
            if not addresses:
                del rows[row]
            if not rows:
                del self._users[port.protocol, port.port]

    def free(self, wanted: Iterable[HostPort], size: int) -> BoolArray:
        """Rows where none of the wanted ports is taken. The wildcard address clashes with every address."""
        result = np.ones(size, dtype=np.bool_)
        for port in wanted:
            for row, addresses in self._users.get((port.protocol, port.port), {}).items():
                if port.ip == ANY_IP or ANY_IP in addresses or port.ip in addresses:
                    result[row] = False
        return result
