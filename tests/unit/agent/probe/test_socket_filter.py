"""What the kernel lets through to the sockets of the probes: the program by itself, and on real sockets of the loopback interface."""

import asyncio
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from tests.support.agent.bpf import accepts
from tests.support.agent.probes import OTHER_SECRET, SECRET, prober, reply_of, request_of, responder, ring

from robotapp_agent.probe.keys import MOST_KEYS, KeyRing, key_of
from robotapp_agent.probe.packets import REPLY, REQUEST, SIZE_BYTES, VERSION, node_id
from robotapp_agent.probe.socket_filter import Instruction, accept, instructions_in, machine_code, program
from robotapp_agent.shell.datagrams import Address, Datagram, DatagramSocket

DEADLINE_S = 60
FAMILIES = [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")]


def filter_of(*secrets: bytes, kind: int = REQUEST, receiver: str = "b") -> tuple[Instruction, ...]:
    """For requests to the node b by keys of these secrets, the ordinary one without any."""
    return program(
        kind=kind, receiver=node_id(receiver), key_ids=[key_of(secret).id for secret in secrets or (SECRET,)]
    )


def test_authentic_datagrams_pass_and_those_of_the_other_direction_do_not() -> None:
    request = request_of(prober("a"))
    reply = reply_of(responder("b"), request)
    to_a = filter_of(kind=REPLY, receiver="a")
    assert (accepts(filter_of(), request), accepts(filter_of(), reply)) == (True, False)
    assert (accepts(to_a, request), accepts(to_a, reply)) == (False, True)


def test_another_receiver_another_key_or_another_size_is_dropped() -> None:
    request = request_of(prober("a"))
    others = [request_of(prober("a"), "c"), request_of(prober("a", keys=ring(OTHER_SECRET)))]
    sizes = [b"", request[:-1], request + b"\0", bytes(1400), request[:1], request[:40]]
    assert not any(accepts(filter_of(), data) for data in (*others, *sizes))


def test_each_of_the_most_keys_that_a_ring_can_have_passes() -> None:
    secrets = [bytes([number]) * 32 for number in range(2 * MOST_KEYS)]
    for secret in secrets:
        assert accepts(filter_of(*secrets), request_of(prober("a", keys=ring(secret))))
    assert not accepts(filter_of(*secrets), request_of(prober("a", keys=ring(SECRET))))


def test_the_halves_of_two_key_ids_make_no_third() -> None:
    first, second = key_of(SECRET).id, key_of(OTHER_SECRET).id
    both = program(kind=REQUEST, receiver=node_id("b"), key_ids=[first, second])
    mixed = bytes([VERSION, REQUEST]) + first[:4] + second[4:] + bytes(16) + node_id("b")
    assert not accepts(both, mixed.ljust(SIZE_BYTES, b"\0"))


def test_without_keys_everything_is_dropped() -> None:
    assert not accepts(program(kind=REQUEST, receiver=node_id("b"), key_ids=[]), request_of(prober("a")))


def test_the_machine_code_has_eight_bytes_per_instruction() -> None:
    assert machine_code([accept()]) == b"\x06\x00\x00\x00\xff\xff\xff\xff"
    assert instructions_in(machine_code(filter_of())) == len(filter_of())


class Listener:
    """A socket that keeps what it reads, and a stranger's one that sends to it. The loopback interface keeps the order."""

    def __init__(self, family: socket.AddressFamily, address: str) -> None:
        self.read: list[bytes] = []
        self._woken = asyncio.Event()
        self.file = DatagramSocket(family, port=0, most_bytes=SIZE_BYTES, handler=self._take)
        self._target: Address = (address, self.file.port)
        self._stranger = socket.socket(family, socket.SOCK_DGRAM)

    def send(self, *datagrams: bytes) -> None:
        for data in datagrams:
            self._stranger.sendto(data, self._target)

    async def until(self, data: bytes) -> list[bytes]:
        """All that was read up to this datagram."""
        async with asyncio.timeout(DEADLINE_S):
            while data not in self.read:
                self._woken.clear()
                await self._woken.wait()
        return self.read

    def close(self) -> None:
        self._stranger.close()
        self.file.close()

    def _take(self, came: Datagram) -> None:
        self.read.append(came.data)
        self._woken.set()


@contextmanager
def listener(family: socket.AddressFamily = socket.AF_INET, address: str = "127.0.0.1") -> Iterator[Listener]:
    try:
        made = Listener(family, address)
    except OSError as error:
        pytest.skip(f"this machine has no {family.name}: {error}")
    try:
        yield made
    finally:
        made.close()


def garbage(count: int) -> list[bytes]:
    """Of each reason for which the kernel can drop a datagram, `count` times."""
    request = request_of(prober("a"))
    near = [bytes([*request[:at], request[at] ^ 1, *request[at + 1 :]]) for at in (0, 1, 2, 9, 26, 41)]
    one_of_each = [b"", request[:-1], request + b"\0", bytes(1400), bytes(SIZE_BYTES), *near]
    return [data for _ in range(count) for data in (*one_of_each, os.urandom(SIZE_BYTES))]


@pytest.mark.parametrize(("family", "address"), FAMILIES)
async def test_the_process_reads_authentic_datagrams_only(family: socket.AddressFamily, address: str) -> None:
    sender = prober("a")
    first, last = request_of(sender), request_of(sender)
    with listener(family, address) as ours:
        assert ours.file.filter(machine_code(filter_of())) is None
        ours.send(*garbage(10), first, *garbage(10), last)
        assert await ours.until(last) == [first, last]


async def test_the_next_program_takes_the_place_of_the_one_before() -> None:
    old, new = (request_of(prober("a", keys=ring(secret))) for secret in (SECRET, OTHER_SECRET))
    with listener() as ours:
        for secrets, wanted in [((SECRET,), [old]), ((SECRET, OTHER_SECRET), [old, new]), ((OTHER_SECRET,), [new])]:
            assert ours.file.filter(machine_code(filter_of(*secrets))) is None
            ours.read.clear()
            ours.send(old, new)
            assert await ours.until(wanted[-1]) == wanted


async def test_a_kernel_that_refuses_the_program_drops_nothing() -> None:
    request, stranger = request_of(prober("a")), bytes(SIZE_BYTES)
    with listener() as ours:
        assert ours.file.filter(b"") is not None
        ours.send(stranger, request)
        assert await ours.until(request) == [stranger, request]
        assert ours.file.filter(machine_code(filter_of())) is None
        assert ours.file.filter(machine_code([Instruction(0xFFFF)])) is not None
        ours.read.clear()
        ours.send(stranger, request)
        assert await ours.until(request) == [stranger, request]


def test_a_ring_reports_other_keys_only_and_only_while_it_is_watched() -> None:
    changes: list[tuple[bytes, ...]] = []
    keys = KeyRing()
    end = keys.watch(lambda: changes.append(keys.ids))
    keys.update({"1": SECRET}, now_s=0)
    keys.update({"1": SECRET}, now_s=1)
    keys.update({"renamed": SECRET}, now_s=2)
    keys.update({"1": SECRET, "2": OTHER_SECRET}, now_s=3)
    keys.update({"2": OTHER_SECRET}, now_s=4)
    keys.update({"2": OTHER_SECRET}, now_s=10_000)
    end()
    keys.update({}, now_s=20_000)
    one, other = key_of(SECRET).id, key_of(OTHER_SECRET).id
    assert [set(ids) for ids in changes] == [{one}, {one, other}, {other}]
