"""Random, truncated, replayed and forged datagrams change nothing, get no reply and cost little; most of them the kernel drops."""

import hmac
import random
import time
from collections.abc import Callable, Iterator

from hypothesis import given
from hypothesis import strategies as st
from tests.support.agent.bpf import accepts
from tests.support.agent.probes import (
    OTHER_SECRET,
    SECRET,
    SESSION,
    TIMEOUT_NS,
    prober,
    reply_of,
    request_of,
    responder,
    ring,
    state,
)

from robotapp_agent.probe.keys import KeyRing, key_of
from robotapp_agent.probe.packets import REPLY, REQUEST, SIZE_BYTES, VERSION, Packet, node_id, open_packet, seal
from robotapp_agent.probe.prober import Prober
from robotapp_agent.probe.responder import Responder
from robotapp_agent.probe.socket_filter import program

COUNT = 10_000
CODES = 10
"""A datagram may cost as much as so many HMACs on the same machine in the same second: below 50 µs where one takes 5."""


def hostile(seed: int, seen: list[bytes]) -> Iterator[bytes]:
    """COUNT datagrams of each kind in turn: random, cut off, replayed, of a stranger, altered. `seen` is what a listener on the wire recorded."""
    chance = random.Random(seed)
    stranger = prober(keys=ring(OTHER_SECRET))

    def forged() -> bytes:
        return request_of(stranger, chance.choice(["a", "b"]))

    def altered() -> bytes:
        data = bytearray(chance.choice(seen))
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        return bytes(data)

    kinds: list[Callable[[], bytes]] = [
        lambda: chance.randbytes(chance.choice([0, 1, SIZE_BYTES, SIZE_BYTES, SIZE_BYTES + 1, 1400])),
        lambda: chance.choice(seen)[: chance.randrange(SIZE_BYTES)],
        lambda: chance.choice(seen),
        forged,
        altered,
    ]
    for index in range(COUNT):
        yield kinds[index % len(kinds)]()


def exchanged(count: int) -> tuple[Prober, Responder, list[bytes]]:
    """Two ends after some probes, one of which is still open, and all that went over the wire."""
    sender, end = prober("a"), responder("b")
    seen = []
    for _ in range(count):
        request = request_of(sender)
        reply = reply_of(end, request)
        assert sender.receive(reply, received_ns=1000, timeout_ns=TIMEOUT_NS)
        seen += [request, reply]
    request_of(sender)
    return sender, end, seen


def test_ten_thousand_hostile_datagrams_change_nothing_and_get_no_reply() -> None:
    sender, end, seen = exchanged(50)
    before = state(sender), state(end)
    for data in hostile(1, seen):
        assert end.answer(data, source="10.0.0.66", received_ns=0) is None
        assert not sender.receive(data, received_ns=2000, timeout_ns=TIMEOUT_NS)
    assert (state(sender), state(end)) == before


@given(st.binary(max_size=2 * SIZE_BYTES))
def test_no_bytes_crash_either_end(data: bytes) -> None:
    assert responder().answer(data, source="10.0.0.66", received_ns=0) is None
    assert not prober().receive(data, received_ns=0, timeout_ns=TIMEOUT_NS)


@given(
    st.sampled_from([REQUEST, REPLY]),
    st.sampled_from(["a", "b", "c"]),
    st.sampled_from([SECRET, OTHER_SECRET]),
    st.sets(st.sampled_from([SECRET, OTHER_SECRET])),
    st.integers(0, 2**64 - 1),
)
def test_the_kernel_lets_an_authentic_datagram_through_when_the_process_takes_it(
    kind: int, receiver: str, secret: bytes, known: set[bytes], sequence: int
) -> None:
    data = seal(Packet(kind, key_of(secret), node_id("a"), node_id(receiver), SESSION, sequence))
    keys = KeyRing()
    keys.update({str(index): each for index, each in enumerate(sorted(known))}, now_s=0)
    steps = program(kind=REQUEST, receiver=node_id("b"), key_ids=keys.ids)
    assert accepts(steps, data) == bool(open_packet(data, kind=REQUEST, receiver=node_id("b"), keys=keys))


def test_of_hostile_datagrams_the_kernel_lets_those_through_that_only_their_code_gives_away() -> None:
    _, _, seen = exchanged(50)
    steps = program(kind=REQUEST, receiver=node_id("b"), key_ids=ring().ids)
    fields = bytes([VERSION, REQUEST]), key_of(SECRET).id, node_id("b")
    for data in hostile(3, seen):
        plausible = len(data) == SIZE_BYTES and (data[:2], data[2:10], data[26:42]) == fields
        assert accepts(steps, data) == plausible


@given(st.binary(max_size=2 * SIZE_BYTES))
def test_the_program_ends_on_any_bytes(data: bytes) -> None:
    assert not accepts(program(kind=REQUEST, receiver=node_id("b"), key_ids=ring().ids), data)


def test_a_hostile_datagram_costs_no_more_than_ten_authentication_codes() -> None:
    """The best of a few tries: other programs of this machine can only make it worse."""
    _, end, seen = exchanged(50)
    datagrams = list(hostile(2, seen))
    shares = []
    for _ in range(5):
        code_s = measured_s(lambda: [hmac.digest(SECRET, data[:62], "sha256") for data in datagrams])
        shares.append(
            measured_s(lambda: [end.answer(data, source="10.0.0.66", received_ns=0) for data in datagrams]) / code_s
        )
    assert min(shares) <= CODES, shares


def measured_s(work: Callable[[], object]) -> float:
    began_s = time.process_time()
    work()
    return time.process_time() - began_s
