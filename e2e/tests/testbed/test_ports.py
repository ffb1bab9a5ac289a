import random
import socket

import pytest

from robotapp_testbed import TestbedError
from robotapp_testbed.processes import ports


def test_ports_are_different_free_and_below_the_ephemeral_range() -> None:
    found = ports.free_ports(20)
    assert len(set(found)) == 20
    assert all(20000 <= port < 32000 and ports.is_free(port) for port in found)


def test_a_port_somebody_listens_on_is_not_free() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        assert not ports.is_free(server.getsockname()[1])


def test_a_taken_port_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    first = random.Random(7).choice(ports._RANGE)
    monkeypatch.setattr(ports, "is_free", lambda port: port != first)
    assert ports.free_ports(1, random.Random(7)) != [first]


def test_no_free_port_is_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ports, "is_free", lambda _: False)
    with pytest.raises(TestbedError, match="end programs that listen there"):
        ports.free_ports(1)
