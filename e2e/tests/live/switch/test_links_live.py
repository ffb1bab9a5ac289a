"""The latency switch between network namespaces of this machine: what is set is what frames meet."""

import socket
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

from campaigns.network.namespaced import Namespace, Wire, round_trips_ms, skip_where_impossible
from robotapp_testbed.processes.process import wait_until

pytestmark = pytest.mark.live
PORT = 5000
TRIES = 8
SILENCE_S = 1.0
"""Nothing comes any more: far above the delays set here and what a busy machine adds."""


@pytest.fixture(scope="module")
def wire() -> Iterator[Wire]:
    skip_where_impossible()
    with Wire(["a", "b", "c"], seed=7) as made:
        made.settle()
        yield made


@pytest.fixture(autouse=True)
def clear_links(wire: Wire) -> None:
    for node in wire.nodes:
        wire.switch.set_node(node, delay_ms=0, jitter_ms=0, loss=0, mbit_s=0, buffer_ms=200, down=False)


def least_ms(wire: Wire, origin: str = "a", target: str = "b", *, below_ms: float, count: int = 5) -> float:
    """The quickest of some round trips, and of more while none is below `below_ms`: what a busy machine adds is not the switch's."""
    least = float("inf")
    for _ in range(TRIES):
        least = min([least, *round_trips_ms(wire.nodes[origin], wire.nodes[target], count=count, pause_s=0.002)])
        if least < below_ms:
            break
    return least


def delivered(origin: Namespace, target: Namespace, count: int, *, size: int = 64, pause_s: float = 0.0) -> list[int]:
    """Numbers of the datagrams that arrived, in the order of their arrival."""
    return burst(origin, target, count, size=size, pause_s=pause_s)[0]


def burst(
    origin: Namespace, target: Namespace, count: int, *, size: int = 64, pause_s: float = 0.0
) -> tuple[list[int], float]:
    """What arrived, and for how many seconds the origin was sending."""
    with target.udp(PORT) as receiver, origin.udp() as sender:
        receiver.settimeout(SILENCE_S)
        numbers = []
        begin_s = time.monotonic()
        for number in range(count):
            sender.sendto(number.to_bytes(4, "big") + bytes(size - 4), (target.address, PORT))
            time.sleep(pause_s)
        sending_s = time.monotonic() - begin_s
        with suppress(TimeoutError):
            while len(numbers) < count:
                numbers.append(int.from_bytes(receiver.recv(2048)[:4], "big"))
    return numbers, sending_s


@pytest.mark.parametrize("delay_ms", [2, 15, 60])
def test_a_round_trip_takes_twice_the_delay(wire: Wire, delay_ms: float) -> None:
    wire.switch.set_link("a", "b", delay_ms=delay_ms)
    most_ms = 2 * delay_ms + 1.5
    assert 2 * delay_ms <= least_ms(wire, below_ms=most_ms, count=15) < most_ms


def test_one_way_changes_one_direction_and_other_pairs_are_untouched(wire: Wire) -> None:
    wire.switch.set_link("a", "b", delay_ms=20, one_way=True)
    assert 20 <= least_ms(wire, below_ms=25) < 25
    assert least_ms(wire, "a", "c", below_ms=5) < 5
    links = wire.switch.links()
    assert (links["a", "b"].delay_ms, links["b", "a"].delay_ms) == (20, 0)


def test_a_node_that_is_down_hears_nothing_until_it_is_up(wire: Wire) -> None:
    wire.switch.set_node("b", down=True)
    assert delivered(wire.nodes["a"], wire.nodes["b"], 5) == []
    assert delivered(wire.nodes["a"], wire.nodes["c"], 5) == list(range(5))
    wire.switch.set_node("b", down=False)
    assert delivered(wire.nodes["a"], wire.nodes["b"], 5) == list(range(5))


def test_multicast_reaches_every_node_and_unicast_only_its_own(wire: Wire) -> None:
    before = wire.switch.counts("frames_total")
    with wire.nodes["a"].udp() as sender:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sender.sendto(b"to all", ("10.9.0.255", PORT))
    assert wait_until(lambda: wire.switch.counts("frames_total")["a", "c"] > before["a", "c"], timeout_s=30)
    assert delivered(wire.nodes["a"], wire.nodes["b"], 10) == list(range(10))
    counts = wire.switch.counts("frames_total")
    assert counts["a", "b"] >= before["a", "b"] + 11
    assert counts["a", "c"] < before["a", "c"] + 5


def test_a_node_that_ended_loses_its_port_and_its_successor_meets_the_old_links(wire: Wire) -> None:
    lost = wire.switch.counts("lost_ports_total")[()]
    with wire.node("d", "10.9.0.9"):
        wire.switch.set_link("a", "d", delay_ms=10)
        assert 20 <= least_ms(wire, "a", "d", below_ms=25) < 25
    assert wait_until(lambda: wire.switch.nodes() == ["a", "b", "c"], timeout_s=30)
    assert wire.switch.counts("lost_ports_total")[()] == lost + 1
    with wire.node("d", "10.9.0.8"):
        assert 20 <= least_ms(wire, "a", "d", below_ms=25) < 25
        wire.switch.detach("d")
        assert wire.switch.nodes() == ["a", "b", "c"]


def test_jitter_spreads_the_delay_and_keeps_the_order(wire: Wire) -> None:
    wire.switch.set_link("a", "b", delay_ms=5, jitter_ms=10, one_way=True)
    trips = round_trips_ms(wire.nodes["a"], wire.nodes["b"], count=40, pause_s=0)
    assert min(trips) >= 5
    assert max(trips) - min(trips) > 4
    numbers = delivered(wire.nodes["a"], wire.nodes["b"], 100)
    assert numbers == list(range(100))
