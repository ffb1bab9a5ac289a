"""Free loopback ports for servers.

Taken from below the kernel's ephemeral range: a port from bind(0) could become the local end of somebody's outgoing connection
while its server is being restarted, and the restart would fail.
"""

import random
import socket

from robotapp_testbed.failures import TestbedError

_RANGE = range(20000, 32000)
_TRIES = 200


def is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # connections in TIME_WAIT do not count
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def free_ports(count: int, chooser: random.Random | None = None) -> list[int]:
    """`count` different ports nobody listens on at 127.0.0.1 now."""
    pick = chooser or random.SystemRandom()
    ports: list[int] = []
    for _ in range(_TRIES + count):
        port = pick.choice(_RANGE)
        if port not in ports and is_free(port):
            ports.append(port)
        if len(ports) == count:
            return ports
    raise TestbedError(
        f"no {count} free ports between {_RANGE.start} and {_RANGE.stop} on 127.0.0.1: end programs that listen there"
    )
